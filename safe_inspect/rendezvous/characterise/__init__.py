"""Characterisation of the target's motion from relative poses: rates, principal axes, inertia ratios and a fit."""
