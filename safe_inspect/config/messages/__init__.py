"""Messages about mistakes in configurations, and the JSON schemas of the files."""
