"""Reports on the safety of tasks: their filters against adversaries, and which initial states they accept."""
