"""Policies: building, saving, loading and freezing; the files of a run, which need neither Ray nor Torch."""
