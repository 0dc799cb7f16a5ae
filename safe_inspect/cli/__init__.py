"""The commands. `main` parses the command line; each other module is a command or is shared by several."""
