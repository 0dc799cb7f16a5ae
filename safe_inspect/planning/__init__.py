"""Planning of inspection trajectories on arrays, compiled and independent of environments and policies.

`coverage_search` finds the plan of least fuel given perfect knowledge of an episode; `burn_search` plans for a deputy
among others and plans again when necessary. The motion follows `safe_inspect.dynamics.step_maps`.
"""
