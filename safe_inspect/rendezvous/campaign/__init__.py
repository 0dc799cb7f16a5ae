"""Many missions of an experiment: how they are flown, their folder, and their tables."""
