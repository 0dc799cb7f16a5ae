"""One mission, what it leaves behind, and many of them."""
