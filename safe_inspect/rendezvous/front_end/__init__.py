"""From depth frames to relative poses of the target."""
