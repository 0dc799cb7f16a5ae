"""Vehicles that turn: position and attitude together."""
