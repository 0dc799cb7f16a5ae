"""Messages about mistakes, and the JSON schemas of the files."""
