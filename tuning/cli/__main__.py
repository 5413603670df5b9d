"""`python -m tuning.cli` is `agvjax`."""

from .start import run

run()
