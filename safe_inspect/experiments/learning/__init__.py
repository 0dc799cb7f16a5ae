"""The PPO learner on arrays."""
