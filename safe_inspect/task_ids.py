"""The shipped tasks and their Gymnasium ids."""

from __future__ import annotations

import gymnasium

#: The experiment file of every registered id, relative to the shipped configurations. If an id changes its meaning, it
#: gets a new version or a new name; Seed ids have the values of the project's first files.
TASKS = {
    "safe_inspect/TranslationalInspectionSeed-v0": "translational-inspection/experiment-seed.yml",
    "safe_inspect/TranslationalInspection-v1": "translational-inspection/experiment.yml",
    "safe_inspect/FilteredTranslationalInspection-v1": "translational-inspection/experiment.yml",
    "safe_inspect/WeightedTranslationalInspection-v0": "weighted-translational-inspection/experiment.yml",
    "safe_inspect/WeightedSixDofInspection-v0": "weighted-six-dof-inspection/experiment.yml",
    "safe_inspect/Docking-v0": "docking/experiment.yml",
    "safe_inspect/TumblingRendezvous-v0": "tumbling-rendezvous-learning/experiment.yml",
}

#: The experiment file of every id with several agents; Gymnasium only makes single agents.
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

#: Former ids and their new names. They work with a warning, because Gymnasium's own warning would recommend version 1,
#: which is a different task.
FORMER_IDS = {
    f"safe_inspect/{team}TranslationalInspection-v0": f"safe_inspect/{team}TranslationalInspectionSeed-v0"
    for team in ("", "Multiagent")
}

#: Overrides of an id to its file: here they enable the safety filter, as the file for three deputies does.
TASK_OVERRIDES = {
    "safe_inspect/FilteredTranslationalInspection-v1": ("RTAGlueCWHInspection1v1.config.enabled=True",),
}


def register_tasks() -> None:
    """Register the ids with Gymnasium; their environments are imported when one is made.

    Ids with several agents are also registered: Gymnasium cannot make them, and the error names the function that can.
    """
    for name in (*ALL_TASKS, *FORMER_IDS):
        if name not in gymnasium.registry:
            gymnasium.register(
                id=name,
                entry_point="safe_inspect.environments.registration:make",
                vector_entry_point="safe_inspect.environments.registration:make_vec",
                kwargs={"cfg": name},
            )
