"""Missions: their truth and sensors, running one, its log, its summary and its files."""
