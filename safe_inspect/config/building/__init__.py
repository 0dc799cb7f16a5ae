"""From models to the specification of an environment."""
