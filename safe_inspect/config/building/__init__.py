"""Construction of an environment's specification from the validated models."""
