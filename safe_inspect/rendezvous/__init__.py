"""Rendezvous with a tumbling target: planning, control and sensing on plain arrays, without Ray or Torch."""
