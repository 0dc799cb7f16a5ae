"""Policies that are loaded from files."""
