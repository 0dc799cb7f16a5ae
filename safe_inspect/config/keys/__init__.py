"""The keys of RLlib, Tune and Ray that are permitted in an experiment, as plain data."""
