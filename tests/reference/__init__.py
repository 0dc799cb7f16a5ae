"""Figures computed a second time, by other means than those of the package."""
