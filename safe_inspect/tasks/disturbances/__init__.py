"""Disturbances of the motion, of the thrusters and of the estimated state, within stated bounds."""
