"""Plans an approach to a point fixed in the body of a tumbling target."""
