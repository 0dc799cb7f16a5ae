"""What a mission does next: the coordinator, its table, guards and actions, and the way out."""
