"""Geometry: the chief's sphere of points, which of them are visible and lit, how they cluster, and other shapes."""
