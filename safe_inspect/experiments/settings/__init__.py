"""From RLlib's, Tune's and Ray's keys of an experiment to settings. Loads neither Ray nor Torch."""
