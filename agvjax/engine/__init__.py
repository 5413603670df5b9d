"""The closed loop in time: one instant, one step, the rollout, and what makes it fast."""
