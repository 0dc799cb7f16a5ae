"""Figures of evaluated episodes: tables, statistics, comparisons and files."""
