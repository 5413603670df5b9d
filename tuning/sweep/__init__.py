"""Robustness sweeps: which scenarios, rolled out in shards by any number of processes, and what they show."""

from .replay import vehicle as vehicle
from .results import Results as Results
from .results import load as load
from .run import run_sweep as run_sweep
