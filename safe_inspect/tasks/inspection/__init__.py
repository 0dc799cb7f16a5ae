"""Inspection: points on bodies that deputies see in sunlight, and the price of fuel."""
