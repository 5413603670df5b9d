"""Bounds on the tracking error that hold for every scenario of a box, proved, with a certificate and its checker."""

from .prove import certify as certify
