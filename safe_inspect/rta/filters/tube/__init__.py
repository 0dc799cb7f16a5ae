"""Tubes about backup plans: what a bounded disturbance can do to a deputy that tracks its plan."""
