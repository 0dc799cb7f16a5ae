"""Registration of depth frames to the known shape of a target."""
