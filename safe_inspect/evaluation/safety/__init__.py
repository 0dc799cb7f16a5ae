"""What safety filters are held against."""
