"""What a run may keep in memory, estimated before it begins."""

from __future__ import annotations

import os

USUAL = 16 * 2**30  # bytes, where the operating system does not say


def memory() -> int:
    """The bytes of this machine's memory."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # Windows has no such function
        return USUAL


def too_much(size: float) -> str:
    """How much memory so many bytes are against what there is; empty if they fit."""
    return f"about {size / 1e9:.3g} GB, this machine has {memory() / 1e9:.3g} GB" if size > memory() else ""
