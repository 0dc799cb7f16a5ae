"""Bounds of the error of the reference that the chaser follows."""
