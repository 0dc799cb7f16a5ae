"""The folder of a run and the files in it: checkpoints, weights of policies. Nothing here loads Ray or Torch."""
