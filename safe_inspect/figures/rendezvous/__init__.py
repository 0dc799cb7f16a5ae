"""Figures, films and pages of rendezvous missions with a tumbling target."""
