"""Flying episodes and recording them."""
