"""How far the reference that the chaser follows may be from the true one."""
