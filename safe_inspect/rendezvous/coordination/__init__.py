"""The coordinator of a mission with its table, guards and actions, and the escape from the target."""
