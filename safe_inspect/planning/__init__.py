"""Planning of inspection trajectories on arrays, compiled and independent of environments and policies.

`coverage` finds the plan of least fuel given perfect knowledge of an episode; `burns` plans for a deputy among others
and plans again when necessary. Both use `visibility` for the points and `safe_inspect.dynamics.step_maps` for the
motion.
"""
