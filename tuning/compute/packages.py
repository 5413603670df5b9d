"""The releases that results hang on."""

from __future__ import annotations

import importlib.metadata

import agvjax

PACKAGES = ("jax", "jaxlib", "numpy", "scipy")


def versions() -> dict[str, str]:
    """Of the libraries that compute, and our own, by name."""
    return {name: importlib.metadata.version(name) for name in PACKAGES} | {"agvjax": agvjax.__version__}
