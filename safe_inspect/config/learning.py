"""Checks that an experiment can be trained, and locations of mistakes in training keys; nothing here loads Ray."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from safe_inspect.config.experiment import Experiment
from safe_inspect.config.keys.old_keys import RENAMED
from safe_inspect.config.keys.rllib_keys import CHANGING_KEYS
from safe_inspect.config.loading.located import has, locate, path_text, value_at
from safe_inspect.config.loading.templates import PLACEHOLDER
from safe_inspect.errors import Problem

_KeyPath = tuple[Any, ...]

_TASK: _KeyPath = ("config", "config")
_POLICY: _KeyPath = ("agent_config", 0, "policy", "config")
_STEP = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def placed(experiment: Experiment, problems: Iterable[Problem]) -> list[Problem]:
    """Return problems whose paths start with `rllib_configs`, `tune_config` or `ray_config`, with their locations."""
    return [_placed(experiment, problem) for problem in problems]


def learning_problems(experiment: Experiment) -> list[Problem]:
    """Return the reasons why the policies cannot learn: an algorithm without support for the actions, or no reward."""
    return [*_unfit_actions(experiment), *_unrewarded(experiment)]


def flight_note(experiment: Experiment) -> str:
    """Return a note about policies that `evaluate` and `export` do not support; empty if they do."""
    config = next(policy.config for policy in experiment.policies.values() if policy.trains)
    keys = {RENAMED.get(key, key): value for key, value in {**experiment.rllib, **config}.items()}
    model = keys.get("model_config") or {}
    recurrent = isinstance(model, Mapping) and model.get("use_lstm")
    changing = next((key for key in CHANGING_KEYS if keys.get(key)), None)
    if changing:
        return f"policies can be trained, but not evaluated: no policy file can contain the code of `{changing}`"
    exported = not recurrent or experiment.algorithm != "DQN"
    return "" if exported else "recurrent policies of DQN cannot be exported to ONNX"


def _unfit_actions(experiment: Experiment) -> list[Problem]:
    """Return the mistake of an algorithm that does not support the actions of the task, with a hint."""
    leaves = [
        (leaf, agent) for agent in experiment.spec.controlled for glue in agent.action_glues for leaf in glue.leaves()
    ]
    counts = [count for leaf, agent in leaves for count in leaf.choices(agent.parts)]
    levels = any(counts)
    actions = "discrete, one level for each controller" if all(counts) else "real numbers"
    actions = f"{actions} and discrete" if levels and not all(counts) else actions
    path = "rllib_configs.algorithm"
    if experiment.algorithm == "DQN" and not all(counts):
        hint = "replace ControllerGlue by DiscreteControllerGlue, or use SAC or PPO"
        return [Problem(f"DQN supports only discrete actions, but these are {actions}", path, hint=hint)]
    if experiment.algorithm == "SAC" and levels:
        hint = "replace DiscreteControllerGlue by ControllerGlue, or use PPO"
        return [Problem(f"SAC supports only continuous actions, but these are {actions}", path, hint=hint)]
    return []


def _unrewarded(experiment: Experiment) -> list[Problem]:
    """Return the policies that cannot learn because none of their agents has a reward."""
    rewards = {agent.name: agent.rewards for agent in experiment.spec.agents}
    text = "no reward, so that nothing can be learned; add one to `rewards`"
    return [
        Problem(f"{', '.join(policy.agents)}: {text}", f"policies.{policy.name}")
        for policy in experiment.policies.values()
        if policy.trains and not any(rewards[agent] for agent in policy.agents)
    ]


def _placed(experiment: Experiment, problem: Problem) -> Problem:
    steps: _KeyPath = tuple(name or int(index) for name, index in _STEP.findall(problem.path))
    if not steps or problem.location is not None:
        return problem
    head, rest = steps[0], steps[1:]
    if head == "policies":
        places: list[_KeyPath] = _places_of_policy(experiment, problem.path)
    elif head == "rllib_configs":
        places = [(*_POLICY, *rest)]
        platforms = experiment.config.config.config.rllib_configs
        places += [(*_TASK, "rllib_configs", name, *rest) for name in platforms]
        if rest == ("algorithm",):
            places = [(*_POLICY[:-1], "algorithm")]
    else:
        places = [(*_TASK, *steps)]
    for place in places:
        if has(value_at(experiment.tree, place[:-1]), place[-1]):
            return Problem(problem.message, path_text(place), locate(experiment.tree, place), problem.hint)
    return problem


def _places_of_policy(experiment: Experiment, path: str) -> list[_KeyPath]:
    """Return the possible paths of ``policies.NAME.KEY``: in the entry, or the template, of an agent of that policy."""
    rest = path.removeprefix("policies.")
    named = [policy for name, policy in experiment.policies.items() if f"{rest}.".startswith(f"{name}.")]
    if not named:
        return []
    policy = max(named, key=lambda policy: len(policy.name))
    key = rest.removeprefix(policy.name).removeprefix(".")
    places: list[_KeyPath] = []
    for index, entry in enumerate(experiment.tree["agent_config"]):
        pattern = re.escape(str(entry["name"])).replace(re.escape(PLACEHOLDER), r"\d+")
        if any(re.fullmatch(pattern, agent) for agent in policy.agents):
            base: _KeyPath = ("agent_config", index, "policy")
            places += [(*base, "config", *key.split(".")), (*base, key), base, base[:-1]]
    return places
