"""Simulated runs, and drives beside what a model makes of them, as files for viewers."""

from .options import Asked as Asked
from .options import asked as asked
from .options import write_runs as write_runs
from .options import write_tracks as write_tracks
