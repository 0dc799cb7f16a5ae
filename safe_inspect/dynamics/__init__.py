"""Equations of motion: matrices and exact maps that act on rows of states."""
