"""The shipped tasks and their Gymnasium ids."""

from __future__ import annotations

import gymnasium

#: The experiment file of every registered id, below the shipped configurations. An id that comes to mean another task
#: takes a new version, or a new name; Seed has the values of the project's first files.
TASKS = {
    "safe_inspect/TranslationalInspectionSeed-v0": "translational-inspection/experiment-seed.yml",
    "safe_inspect/TranslationalInspection-v1": "translational-inspection/experiment.yml",
    "safe_inspect/FilteredTranslationalInspection-v1": "translational-inspection/experiment.yml",
    "safe_inspect/WeightedTranslationalInspection-v0": "weighted-translational-inspection/experiment.yml",
    "safe_inspect/WeightedSixDofInspection-v0": "weighted-six-dof-inspection/experiment.yml",
    "safe_inspect/Docking-v0": "docking/experiment.yml",
    "safe_inspect/TumblingRendezvous-v0": "tumbling-rendezvous-learning/experiment.yml",
}

#: The experiment file of every id that stands for several agents; Gymnasium makes single agents only.
TEAM_TASKS = {
    "safe_inspect/MultiagentTranslationalInspectionSeed-v0": "multiagent-translational-inspection/experiment-seed.yml",
    "safe_inspect/MultiagentTranslationalInspection-v1": "multiagent-translational-inspection/experiment.yml",
    "safe_inspect/MultiagentWeightedTranslationalInspection-v0": (
        "multiagent-weighted-translational-inspection/experiment.yml"
    ),
    "safe_inspect/MultiagentWeightedSixDofInspection-v0": "multiagent-weighted-six-dof-inspection/experiment.yml",
    "safe_inspect/MultiagentDocking-v0": "multiagent-docking/experiment.yml",
}


ALL_TASKS = TASKS | TEAM_TASKS

#: Former ids and the present ones. They work, with a warning, for Gymnasium's own recommends version 1, another task.
FORMER_IDS = {
    f"safe_inspect/{team}TranslationalInspection-v0": f"safe_inspect/{team}TranslationalInspectionSeed-v0"
    for team in ("", "Multiagent")
}

#: What an id changes in its file: here the safety filter is on, as it is in the file of three deputies.
TASK_OVERRIDES = {
    "safe_inspect/FilteredTranslationalInspection-v1": ("RTAGlueCWHInspection1v1.config.enabled=True",),
}


def register_tasks() -> None:
    """Register the ids with Gymnasium; what they stand for is imported when one is made.

    Those of several agents are registered too: Gymnasium cannot make them, and the error names what can.
    """
    for name in (*ALL_TASKS, *FORMER_IDS):
        if name not in gymnasium.registry:
            gymnasium.register(
                id=name,
                entry_point="safe_inspect.environments.registration:make",
                vector_entry_point="safe_inspect.environments.registration:make_vec",
                kwargs={"cfg": name},
            )
