"""Estimation pipeline of a mission: sensors, front end, back end and characterisation in the loop."""
