"""`python -m tuning` is `agvjax`."""

from .cli.start import run

run()
