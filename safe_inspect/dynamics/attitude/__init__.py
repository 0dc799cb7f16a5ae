"""Dynamics of vehicles that turn: position and attitude together."""
