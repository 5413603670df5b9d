"""Figures and animations: the only files that import matplotlib."""
