"""Filters that keep deputies apart: jointly for a team, or separately for each deputy."""
