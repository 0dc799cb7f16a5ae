"""Policies: how they are made, saved, loaded and frozen."""
