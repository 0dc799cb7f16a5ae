"""Tubes about backup plans: bounds on the effect of a disturbance on a deputy that tracks its plan."""
