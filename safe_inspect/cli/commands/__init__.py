"""What the commands do. A module is imported when its command runs, so that the others need not wait for it."""
