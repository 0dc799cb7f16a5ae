"""Translation of an experiment's RLlib, Tune and Ray keys into settings. Imports neither Ray nor Torch."""
