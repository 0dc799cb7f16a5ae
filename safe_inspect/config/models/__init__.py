"""The models of an experiment's files."""
