"""Environment runners that step a whole batch, and what they report."""
