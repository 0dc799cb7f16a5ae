"""The pilot of a mission: the coordinator with its table, guards and actions, and the escape from the target."""
