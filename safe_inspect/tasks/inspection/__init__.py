"""Inspection: points on bodies that deputies see in the light of the sun, and the price of fuel."""
