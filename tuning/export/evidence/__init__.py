"""Evidence about an exported controller in C: checks by compilers, analysers, a simulator; a page that traces them."""

from .collect import gather
from .page import verdict

__all__ = ["gather", "verdict"]
