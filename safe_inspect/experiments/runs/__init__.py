"""Training runs: Ray, Tune, progress, logs and the trials of a search."""
