"""The modules of the commands with their arguments and functions; each is imported when its command line is parsed."""
