"""`load_experiment`: builds a checked `Experiment` from a file and overrides; each step reports all its mistakes.

Every command that takes ``--cfg FILE`` of an environment, and every function that makes an environment, comes here; a
rendezvous goes to `safe_inspect.rendezvous.experiment.load_rendezvous` (``validate``, ``evaluate`` and ``compare``
look at the file first to tell the two apart, by `is_rendezvous`). In ``python -m safe_inspect.train_rl --cfg FILE``,
`cli.main.run_command` parses the words of the command line, and `cli.commands.train.run` calls `load_experiment`, then
`cli.checked_settings`, which checks the settings of the training, then `experiments.runs.train.train`, which starts
Ray. The steps of `load_experiment` are:

1. `_file_of` finds the file, if the name is the id of a task.
2. `loader.load` opens it, and reads it and what it includes, as a tree with the location of every value. ``./FILE``
   is next to the including file; any other name is searched in the working directory, in the folder that contains
   ``configs``, and in this package.
3. `layers.experiment_tree` merges its layers and moves short keys to their full paths. It also reads the files that
   safe-autonomy-sims names by plain paths, without ``!include``.
4. `build_experiment` replaces the values that a task's id and then the command line give
   (`overrides.apply_overrides`; a path may be the end of exactly one full path), imports plugins, expands templates
   and references, and validates the tree with the `models`, which builds the plugins.
5. `building` checks how they fit together: `team.policies_of` returns the policies, and, after the keys of RLlib, the
   horizon and the seed (`_rllib`, `_horizon`, `_seed`), `assemble.assemble` the `EnvironmentSpec`.

The `EnvironmentSpec` is only a specification: ``TeamEnvironment(spec, num_envs)`` is the environment. `make`,
evaluations and ``train --dry-run`` pass `Experiment.spec`. A training passes `Experiment.resolved` instead, from which
each of its runners builds a specification again (`build_team` in `experiments.sampling.environment` calls
`build_experiment`).
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

from pydantic import ValidationError

from safe_inspect.config.building.assemble import assemble
from safe_inspect.config.building.team import policies_of
from safe_inspect.config.data import configs_root
from safe_inspect.config.layers import experiment_tree
from safe_inspect.config.loading.loader import import_plugins, load
from safe_inspect.config.loading.located import REPLACED, LocatedDict, Place, ResolvedExperiment, locate, path_text
from safe_inspect.config.loading.references import STORE, expand_references
from safe_inspect.config.loading.templates import expand_templates
from safe_inspect.config.models import ENVIRONMENT_PATH, ExperimentConfig
from safe_inspect.config.overrides import apply_overrides
from safe_inspect.config.report import problems_of
from safe_inspect.config.spec import EnvironmentSpec, PolicySpec
from safe_inspect.dones.limits import MAX_HORIZON, EpisodeLengthDone
from safe_inspect.errors import ConfigError, Problem, did_you_mean
from safe_inspect.task_ids import ALL_TASKS, FORMER_IDS, TASK_OVERRIDES


@dataclass(frozen=True)
class Experiment(ResolvedExperiment):
    """A checked experiment.

    Attributes:
        source: The file from which it was loaded.
        tree: The whole resolved configuration, see `ResolvedExperiment`.
        config: The validated models.
        spec: The specification from which environments are made.
        rllib: RLlib keys of the task, overridden by those that all trained policies have in common.
        algorithm: Name of the RLlib algorithm.
        policies: Policies by name, in agent order, without scripted ones, which are part of the environment. Their
            `config` contains the keys that are not in `rllib`.
    """

    config: ExperimentConfig
    spec: EnvironmentSpec
    rllib: dict[str, Any]
    algorithm: str
    policies: Mapping[str, PolicySpec]


#: Messages about something that the list of an included file may have contained.
_MISSING = re.compile(r"^no \w+ is named|^the key is missing")


def load_experiment(
    path: str | os.PathLike[str], overrides: Iterable[str] = (), *, compute_platform: str = "local"
) -> Experiment:
    """Load and check an experiment file.

    Args:
        path: The file, or an id such as ``safe_inspect/TranslationalInspectionSeed-v0``.
        overrides: ``path.of.keys=value`` for each value to replace.
        compute_platform: Name of the task's `rllib_configs` to use; ``default`` if that name does not exist.

    Raises:
        ConfigError: The experiment has mistakes; all of the first step that finds some are listed, each with its file,
            line and path of keys.
    """
    if isinstance(overrides, str):
        raise ConfigError(Problem("overrides must be a list of strings", hint=f"write [{overrides!r}]"))
    if not isinstance(path, str | os.PathLike) or not os.fspath(path):
        hint = "; use `build_spec` for a resolved configuration" if isinstance(path, Mapping) else ""
        raise ConfigError(Problem(f"a configuration must be a file path or a task id, not {path!r:.60}{hint}"))
    file, own = _file_of(os.fspath(path))
    tree = experiment_tree(load(file), file)
    return build_experiment(tree, file, [*own, *overrides], compute_platform=compute_platform)


def _file_of(name: str) -> tuple[str, Iterable[str]]:
    """Return the file of a task's id and the overrides that belong to the id; any other name is that of a file."""
    if name in FORMER_IDS:
        former, name = name, FORMER_IDS[name]
        text = f"{former} is now called {name}; use that name (version 1 is a different task, not a newer version)"
        warnings.warn(text, FutureWarning, stacklevel=3)
    if name in ALL_TASKS:
        return os.fspath(configs_root() / ALL_TASKS[name]), TASK_OVERRIDES.get(name, ())
    if os.path.exists(name):
        return name, ()
    if name.startswith("safe_inspect/"):
        raise ConfigError(Problem(f"there is no task with the id {name!r}", hint=did_you_mean(name, ALL_TASKS)))
    if not os.path.dirname(name) and not os.path.splitext(name)[1]:
        near = get_close_matches(name, [task.partition("/")[2] for task in ALL_TASKS], n=1)
        if near:
            raise ConfigError(Problem(f"no file or task {name!r}", hint=f"did you mean `safe_inspect/{near[0]}`?"))
    return name, ()


def build_experiment(
    tree: Any, source: str = "", overrides: Iterable[str] = (), *, compute_platform: str = "local"
) -> Experiment:
    """Build a checked experiment from a resolved configuration, such as `Experiment.resolved`.

    Args:
        tree: The resolved configuration.
        source: Name of the file from which it was loaded.
        overrides: ``path.of.keys=value`` for each value to replace.
        compute_platform: See `load_experiment`.

    Raises:
        ConfigError: The configuration has mistakes; all are listed.
    """
    tree = apply_overrides(tree if isinstance(tree, LocatedDict) else LocatedDict(tree), overrides)
    import_plugins(tree, (*ENVIRONMENT_PATH, "plugin_paths"))
    problems: list[Problem] = []
    expanded = expand_references(expand_templates(tree, problems), problems)
    try:
        config = ExperimentConfig.model_validate(expanded)
    except ValidationError as error:
        found = [*problems, *problems_of(error, expanded, model=ExperimentConfig)]
        raise ConfigError(_listed(found, expanded)) from None
    root = Place(expanded, problems)
    for name, entries in (("platform_config", config.platform_config), ("agent_config", config.agent_config)):
        if not entries:
            root.report("the list is empty; add an entry", name)
            raise ConfigError(problems)
    policies = policies_of(config, root)
    rllib, policies = _rllib(config, policies, compute_platform, root)
    horizon = _horizon(config, rllib, root)
    spec = assemble(config, horizon, root, seed=_seed(rllib))
    if problems or spec is None:
        raise ConfigError(_listed(problems, expanded))
    algorithm = next(policy.algorithm for policy in policies.values() if policy.trains)
    return Experiment(source, tree, config, spec, rllib, algorithm, policies)


def _listed(problems: list[Problem], tree: Any) -> list[Problem]:
    """Return the problems to print.

    Those that a template repeats for each of its agents (same place, same mistake) are left out. If something is
    missing that a replaced list may have contained, a last line says which list was replaced.
    """
    kept: dict[Any, Problem] = {}
    for problem in problems:
        key = (problem.message, problem.location, problem.hint) if problem.location is not None else problem
        kept.setdefault(key, problem)
    listed = list(kept.values())
    if any(_MISSING.search(problem.message) for problem in listed):
        listed += replaced_lists(tree)
    return listed


def replaced_lists(tree: Any, path: tuple[Any, ...] = ()) -> Iterator[Problem]:
    """Yield a line for each list of mappings, or list to refer to, in a file that replaced that of an included file."""
    before = getattr(tree, "marks", {}).get(REPLACED)
    named = isinstance(tree, list) and (STORE in path[-2:-1] or any(isinstance(item, Mapping) for item in tree))
    if named and before is not None and tree.location is not None and before.file != tree.location.file:
        message = f"this list replaces that of {before}, so its items are gone"
        hint = f"append with `{path[-1]}+: [...]`, or change an item by its name with `{path[-1]}: {{NAME: ...}}`"
        yield Problem(message, path_text(path), tree.location, hint)
    for key, value in tree.items() if isinstance(tree, Mapping) else enumerate(tree) if isinstance(tree, list) else ():
        yield from replaced_lists(value, (*path, key))


def _rllib(
    config: ExperimentConfig, policies: dict[str, PolicySpec], compute_platform: str, root: Place
) -> tuple[dict[str, Any], dict[str, PolicySpec]]:
    """Return the RLlib keys that apply to all policies, and the policies with their additional keys."""
    configs = config.config.config.rllib_configs
    name = compute_platform if compute_platform in configs else "default"
    if configs and name not in configs:
        text = f"there is no {compute_platform!r}; {did_you_mean(compute_platform, configs)}"
        root.report(text, "config", "config", "rllib_configs")
    learning = [policy.config for policy in policies.values() if policy.trains]
    common = {
        key: value
        for key, value in (learning[0] if learning else {}).items()
        if all(key in other and other[key] == value for other in learning[1:])
    }
    own = {
        name: replace(policy, config={key: value for key, value in policy.config.items() if key not in common})
        for name, policy in policies.items()
    }
    given = configs.get(name, {})
    for key, value in given.items():
        found = [policy.get(key, value) for policy in learning]
        where = locate(root.tree, (*root.path, "config", "config", "rllib_configs", name, key))
        if found and value not in found and where is not None and not where.line:  # meant, as it is on the command line
            warnings.warn(f"{where} has no effect: each agent's `policy` has {found[0]}; change it there", stacklevel=2)
    return {**given, **common}, own


def _horizon(config: ExperimentConfig, rllib: dict[str, Any], root: Place) -> int:
    """Return the time limit from the environment or, as in safe-autonomy-sims, from the RLlib keys.

    If both contain one, that of the environment applies, as in safe-autonomy-sims; that of the RLlib keys is not
    removed, so that training reports that it has no effect.
    """
    own, other = config.environment.horizon, rllib.get("horizon")
    if own is None or own == other:
        rllib.pop("horizon", None)
    if other is not None and (isinstance(other, bool) or not isinstance(other, int) or not 1 <= other <= MAX_HORIZON):
        message = f"`horizon` must be a number of steps from 1 to {MAX_HORIZON}, not {other!r}"
        root.report(message, "config", "config", "rllib_configs")
        other = None
    horizon = own or other
    for index, entry in enumerate(config.agent_config):
        for place, done in enumerate(entry.body.dones):
            limit = done.functor.horizon if isinstance(done.functor, EpisodeLengthDone) else None
            if limit is not None and horizon is not None and limit != horizon:
                text = f"the horizon is {limit} here but {horizon} in the environment; remove one of them"
                root.report(text, "agent_config", index, "config", "config", "dones", place)
    return horizon or 1224


def _seed(rllib: Mapping[str, Any]) -> int:
    seed = rllib.get("seed")
    return seed if isinstance(seed, int) and 0 <= seed < 2**64 else 0  # others are reported with the keys of RLlib
