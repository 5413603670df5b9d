"""The tuning problem and its solution: `pose`, `solve`, `judge`."""
