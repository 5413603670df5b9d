"""How fast, how large, how accurate: `python -m benchmarks` runs everything, `python -m benchmarks PART` one part."""
