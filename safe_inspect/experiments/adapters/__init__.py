"""The environments as RLlib takes them, and the algorithm's configuration."""
