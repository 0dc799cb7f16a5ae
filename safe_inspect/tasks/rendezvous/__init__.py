"""Rendezvous with a tumbling target: its motion and shape, and what docking is."""
