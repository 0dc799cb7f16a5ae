"""Docking with a chief at rest, whose speed limit decreases with the range, and with a tumbling target of boxes."""
