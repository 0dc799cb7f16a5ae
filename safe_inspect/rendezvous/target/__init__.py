"""The target: its shape, its mass properties and its mating point."""
