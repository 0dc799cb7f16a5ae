"""Estimation of chaser and target: a factor graph of poses and inertial samples, and the estimators of a mission."""
