"""Backup filter: its search for a plan, its certificate of a hold, and its cutting planes."""
