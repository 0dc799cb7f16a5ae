"""From the history of relative poses to the target's motion: rates, principal axes, inertia ratios, and a fit."""
