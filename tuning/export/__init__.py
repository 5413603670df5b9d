"""A tuned controller that runs without Python, or without JAX: C, NumPy, ROS 2, StableHLO, all from the one law."""
