"""The folder of a run and its files, such as checkpoints and weights of policies. Nothing here loads Ray or Torch."""
