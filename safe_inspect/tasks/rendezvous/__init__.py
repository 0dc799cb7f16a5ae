"""Rendezvous with a tumbling target: the target's motion and shape, and the conditions of docking."""
