"""What tries to break safety filters: grazing states, adversarial thrusts and disturbances."""
