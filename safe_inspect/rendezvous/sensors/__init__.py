"""Simulated sensors of the chaser, computed from the true states."""
