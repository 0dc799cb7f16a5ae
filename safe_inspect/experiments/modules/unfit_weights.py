"""`unfit_weights`: initial weights that do not fit a policy are found before Ray is loaded."""

from __future__ import annotations

from safe_inspect.config.experiment import Experiment
from safe_inspect.errors import CheckpointError, Problem
from safe_inspect.experiments.modules.policy_info import policy_info
from safe_inspect.experiments.modules.starting_weights import starting_weights
from safe_inspect.experiments.modules.weights_file import INFO
from safe_inspect.experiments.runs.training_run import Settings


def unfit_weights(experiment: Experiment, settings: Settings) -> list[Problem]:
    """Return what is wrong with the weights with which the policies are to begin.

    Args:
        experiment: The experiment.
        settings: From `read_settings`, without problems.
    """
    agents = [agent for agent in experiment.spec.agents if agent.scripted_policy is None]
    common, problems = settings.trials[0].rllib.settings.get("model_config", {}), []
    for name, policy in experiment.policies.items():
        own = settings.policies[name].settings.get("model_config", {}) if name in settings.policies else {}
        source = {**common, **own}.get("initial_weights")
        if source is None or not policy.trains:
            continue
        info = policy_info(experiment, name, [agent for agent in agents if agent.name in policy.agents])
        try:
            starting_weights(source, {INFO: info.metadata()})
        except CheckpointError as error:
            where = f"policies.{name}" if name in settings.policies else "rllib_configs"
            problems.append(Problem(str(error), f"{where}.model_config.initial_weights"))
    return problems
