"""Environment runners that step a whole batch, and their reports."""
