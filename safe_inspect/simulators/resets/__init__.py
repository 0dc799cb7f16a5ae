"""Resets: parameters, initialisers and the plan from which the initial state of an episode is drawn."""
