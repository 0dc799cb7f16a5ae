"""Planning of an approach to a point that is fixed in the body of a tumbling target."""
