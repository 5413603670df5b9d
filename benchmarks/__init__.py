"""How fast, how large, how accurate: `python -m benchmarks` runs everything, `python -m benchmarks PART` one part."""

import os

os.environ["AGVJAX_XLA"] = "0"  # contestants say themselves which compiler options they run with
