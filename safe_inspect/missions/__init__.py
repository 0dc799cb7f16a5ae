"""Missions to a tumbling target: truth, sensors, faults, log, summary, files, and logs of sensors alone."""
