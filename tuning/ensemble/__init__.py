"""The scenarios to tune for: distributions, samples, and the worst of a box."""
