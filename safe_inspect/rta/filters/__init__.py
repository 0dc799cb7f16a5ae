"""Safety filters: each changes a desired control to one that satisfies the constraints."""
