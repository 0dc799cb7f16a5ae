"""The shipped tasks and their Gymnasium ids."""

from __future__ import annotations

import gymnasium

#: The experiment file of every registered id, below the shipped configurations.
TASKS = {
    "safe_inspect/TranslationalInspection-v0": "translational-inspection/experiment-seed.yml",
    "safe_inspect/WeightedTranslationalInspection-v0": "weighted-translational-inspection/experiment.yml",
    "safe_inspect/WeightedSixDofInspection-v0": "weighted-six-dof-inspection/experiment.yml",
    "safe_inspect/Docking-v0": "docking/experiment.yml",
    "safe_inspect/TumblingRendezvous-v0": "tumbling-rendezvous-learning/experiment.yml",
}

#: The experiment file of every id that stands for several agents; Gymnasium knows single agents only.
TEAM_TASKS = {
    "safe_inspect/MultiagentTranslationalInspection-v0": "multiagent-translational-inspection/experiment-seed.yml",
    "safe_inspect/MultiagentWeightedTranslationalInspection-v0": (
        "multiagent-weighted-translational-inspection/experiment.yml"
    ),
    "safe_inspect/MultiagentWeightedSixDofInspection-v0": "multiagent-weighted-six-dof-inspection/experiment.yml",
    "safe_inspect/MultiagentDocking-v0": "multiagent-docking/experiment.yml",
}


ALL_TASKS = TASKS | TEAM_TASKS


def register_tasks() -> None:
    """Register the ids with Gymnasium; what they stand for is imported when one is made."""
    for name in TASKS:
        if name not in gymnasium.registry:
            gymnasium.register(
                id=name,
                entry_point="safe_inspect.environments.registration:make",
                vector_entry_point="safe_inspect.environments.registration:make_vec",
                kwargs={"cfg": name},
            )
