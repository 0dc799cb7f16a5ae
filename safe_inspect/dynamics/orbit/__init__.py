"""Orbits about the Earth: the chief's orbit, motion relative to it, and the Earth's shadow."""
