"""Robustness sweeps: which scenarios, rolled out in shards by any number of processes, and what they show."""
