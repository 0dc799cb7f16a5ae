"""The models of the files of an experiment."""
