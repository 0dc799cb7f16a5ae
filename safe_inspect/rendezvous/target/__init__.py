"""The target: its shape, its mass properties, its mating point and its tumble."""
