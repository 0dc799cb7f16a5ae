"""Solvers of the filters: the nearest point of a polyhedron, in three or more dimensions; see README.md."""
