"""One module for each command or few: its arguments, and what it does; imported when its command line is parsed."""
