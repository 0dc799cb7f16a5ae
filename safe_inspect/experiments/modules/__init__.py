"""Policies: building, saving, loading and freezing."""
