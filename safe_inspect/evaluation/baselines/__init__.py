"""Baselines: episodes of scripted policies and of optimised plans, as references for trained policies."""
