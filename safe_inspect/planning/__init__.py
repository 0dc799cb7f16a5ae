"""Planning with perfect knowledge: the least fuel for which an episode can be won, as a reference for policies."""
