"""Draws of a place, counted from another origin."""

from __future__ import annotations

import dataclasses

import numpy as np

from .draws import Between, Correlated, Distribution, Draw, OneOf


def moved(draw: Draw, by: np.ndarray) -> Draw:
    """The same places (`by` of shape (2,) or ()) counted from an origin that lies so far [m] on the other side.

    Raises:
        ValueError: it draws x and y alike, and they do not move alike.
    """
    if isinstance(draw, Correlated):
        return dataclasses.replace(draw, marginal=moved(draw.marginal, by))
    if isinstance(draw, Between):
        low, high = (np.asarray(end) + by for end in (draw.low, draw.high))
        ends = [end.item() if end.ndim == 0 else tuple(end.tolist()) for end in (low, high)]
        return Between(*ends)
    if not isinstance(draw, (OneOf, Distribution)) or (isinstance(draw, Distribution) and draw.times):
        return draw  # it counts from the nominal value
    if by.ndim:
        raise ValueError("{ between = [[low, high], [low, high]] } or { plus = [low, high] }: x and y are not alike")
    if isinstance(draw, OneOf):
        return OneOf(tuple((np.asarray(draw.values) + by).tolist()))
    return dataclasses.replace(draw, parameters={**draw.parameters, "loc": draw.parameters.get("loc", 0.0) + by.item()})
