"""Figures of flown episodes: tables, statistics, comparisons, files."""
