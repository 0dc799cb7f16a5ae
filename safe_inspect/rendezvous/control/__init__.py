"""Track a plan: bounds of the reference's error, tubes, gains, model predictive control and attitude control."""
