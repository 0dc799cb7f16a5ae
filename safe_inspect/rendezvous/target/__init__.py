"""The target: its shape, its mass properties, and where the chaser shall go."""
