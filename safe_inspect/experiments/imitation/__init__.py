"""Warm start: a policy clones a scripted one before its training begins."""
