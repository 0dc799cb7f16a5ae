"""Planning of inspection flights on arrays, compiled: no environment, no policy.

`coverage` finds the least fuel with perfect knowledge of an episode, `burns` plans for a deputy that flies in company
and plans anew. Both see the points through `visibility` and move by `safe_inspect.dynamics.step_maps`.
"""
