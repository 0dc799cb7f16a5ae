"""What a reset draws: parameters, initialisers and the plan of an episode's initial state."""
