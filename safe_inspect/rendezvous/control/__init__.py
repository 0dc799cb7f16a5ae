"""Track a plan: bounds of the error of a reference, tubes, gains, feedback in a tube, and attitude control."""
