"""Docking with a chief at rest in Hill's frame: a region to reach, and a speed limit that decreases with the range."""
