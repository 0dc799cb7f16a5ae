"""Tracking of a plan: tubes, gains, model predictive control, attitude control."""
