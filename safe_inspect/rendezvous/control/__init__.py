"""Track a plan: tubes, gains, model predictive control and attitude control."""
