"""Front ends, which compute relative poses of the target from depth frames."""
