"""Planning of inspection trajectories on arrays, independent of environments and policies.

`burn_search` plans for a deputy, also among others, and plans again when necessary; `plan_refinement` reduces the fuel
of a plan by linear programmes. The motion follows `safe_inspect.dynamics.step_maps`.
"""
