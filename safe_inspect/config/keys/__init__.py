"""The keys of RLlib, Tune and Ray that an experiment may give, as plain data."""
