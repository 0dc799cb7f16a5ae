"""Rollouts: running episodes and recording them."""
