"""Rare failures: the probability that a vehicle of the ensemble fails, down to 1e-6, and the most likely failures."""

from .study import search as search
