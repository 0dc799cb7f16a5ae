"""Factor graph that estimates the states of chaser and target from relative poses and inertial measurements."""
