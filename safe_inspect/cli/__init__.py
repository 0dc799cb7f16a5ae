"""The commands. `main` parses; each other module is a command, or what several share."""
