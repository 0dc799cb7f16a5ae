"""Pictures of missions to a tumbling target."""
