"""`python -m tuning.cli` is `agvjax`."""

from .main import run

run()
