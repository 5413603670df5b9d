"""Law and vehicle as FMUs, which co-simulation tools import: FMI 2.0 and 3.0, source and binary."""

from .controller import NAME, files

__all__ = ["NAME", "files"]
