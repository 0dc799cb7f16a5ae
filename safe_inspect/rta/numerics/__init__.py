"""Solvers of the filters: the nearest point of a polyhedron, of three variables and of many; see README.md."""
