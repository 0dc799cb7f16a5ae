"""Rendezvous with a tumbling target: planning, control and sensing on plain arrays. No Ray, no Torch."""
