"""Sensors of the chaser, simulated on the true state."""
