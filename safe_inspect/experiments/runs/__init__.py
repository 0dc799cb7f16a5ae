"""Trainings: run folders, checkpoints, progress, trials."""
