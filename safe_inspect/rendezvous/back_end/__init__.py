"""From relative poses and inertial measurements to the states of chaser and target: a factor graph."""
