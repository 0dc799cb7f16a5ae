"""Missions: running one, its log, its summary and its files."""
