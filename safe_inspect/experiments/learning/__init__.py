"""The PPO learner on arrays, and the configuration of RLlib's algorithms."""
