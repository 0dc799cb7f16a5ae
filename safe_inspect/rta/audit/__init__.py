"""Audit of the safety filters: grazing states, adversarial thrusts and disturbances."""
