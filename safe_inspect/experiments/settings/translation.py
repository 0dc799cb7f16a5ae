"""Checks of an experiment's keys for RLlib, Tune and Ray, and translation of old names.

Nothing here imports Ray, so that `safe-inspect validate` takes a fraction of a second.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from annotated_types import Ge

from safe_inspect.config.keys import old_keys, run_keys
from safe_inspect.config.keys import rllib_keys as keys
from safe_inspect.config.keys.rllib_keys import keys_of_release
from safe_inspect.config.keys.value_types import NUMBER, numeric
from safe_inspect.errors import Problem, did_you_mean
from safe_inspect.experiments.settings.key_tables import KeyTables, TranslatedSettings, is_searched

_MODEL = KeyTables(keys.MODEL_KEYS | keys.FRESH_KEYS, old_keys.MODEL_RENAMED, {}, old_keys.MODEL_ONLY_AT)
_REFUSED = old_keys.RESERVED | dict.fromkeys(_MODEL.known, "it is a key of `model_config`")
_TUNE = KeyTables(run_keys.TUNE_KEYS, run_keys.TUNE_RENAMED, run_keys.TUNE_DROPPED, run_keys.TUNE_ONLY_AT)
#: Tune runs the code in a mapping with this key.
_EVAL = "eval"
#: The default metric by which trials are ranked.
METRIC = "env_runners/episode_return_mean"
_LIMIT = numeric(float, Ge(1))
#: Criteria to stop a training. Tune ignores those that are never reported, and the training would never end.
_STOP = KeyTables(
    dict.fromkeys(run_keys.STOP_KEYS, NUMBER) | dict.fromkeys(run_keys.STOP_COUNTS, _LIMIT),
    run_keys.STOP_RENAMED,
    {},
    {},
    spellings={name: new for name, new in run_keys.STOP_RENAMED.items() if "/" in name or name in new},
    defaults=False,
    unknown="training cannot stop on `{}`, which is never reported",
)
_RAY = KeyTables(run_keys.RAY_KEYS, run_keys.RAY_RENAMED, run_keys.RAY_DROPPED, {})


def translate_rllib(mapping: Mapping[str, Any], algorithm: str | None = None) -> TranslatedSettings:
    """Return the settings of the RLlib algorithm, with this package's defaults filled in.

    Args:
        mapping: The merged `rllib_configs` of the experiment.
        algorithm: The name of the algorithm in `tune_config`; None if it gives none.
    """
    name, wrong = _algorithm(mapping, algorithm)
    found = _rllib(mapping, "rllib_configs", name)
    found.problems[:0] = wrong
    settings = {**keys.COMMON_DEFAULTS, **keys.ALGORITHM_DEFAULTS.get(name, {}), **found.settings, "algorithm": name}
    settings["model_config"] = {**keys.MODEL_DEFAULTS, **found.settings.get("model_config", {})}
    if not found.problems:
        found.problems += _fit_batch(settings, found.given)
    notes, wrong = _choose_fast_paths(settings)
    found.notes += notes
    found.problems += wrong
    found.settings = settings
    return found


def current_name(given: str) -> str:
    """Return RLlib's current name of a key of the algorithm, given its current name or an old one."""
    name = old_keys.SPELLINGS.get(given, given)
    return old_keys.RENAMED.get(name, name)


def translate_tune(mapping: Mapping[str, Any]) -> TranslatedSettings:
    """Return the settings of `tune.Tuner`, with `algorithm` among them if the mapping names one."""
    found = _TUNE.translate(mapping, "tune_config")
    found.settings = settings = {**run_keys.TUNE_DEFAULTS, **found.settings}
    problems, notes = found.problems, found.notes
    stop = settings.get("stop")
    settings["stop"] = {}
    if not stop and settings.get("time_budget_s") is None:
        notes.append(
            "the training runs until it is interrupted; to limit it, give `stop`, such as `training_iteration=100`"
        )
    if isinstance(stop, Mapping):
        found.nest("stop", _STOP.translate(stop, "tune_config.stop"))
    score = settings.get("checkpoint_score_attribute")
    if score:
        if score.startswith("min-"):
            score, settings["checkpoint_score_order"] = score[4:], "min"
        settings["checkpoint_score_attribute"] = run_keys.STOP_RENAMED.get(score, score)
    metric = settings.get("metric") or METRIC
    settings["metric"], settings["mode"] = run_keys.STOP_RENAMED.get(metric, metric), settings.get("mode") or "max"
    for key in ("checkpoint_score_attribute", "metric"):
        figure = settings.get(key)
        # A name with a slash may be that of a value that a callback logs.
        if figure and figure not in run_keys.STOP_KEYS and "/" not in figure:
            known = [*run_keys.STOP_KEYS, *run_keys.STOP_RENAMED]
            message = f"`{figure}` is never reported"
            problems.append(Problem(message, f"tune_config.{key}", hint=did_you_mean(figure, known)))
    if settings.get("scheduler") is None and settings.get("search_alg") is None:
        notes += [
            f"`{key}` has no effect: it ranks trials for a `scheduler` or a `search_alg`, and neither is given"
            for key in ("metric", "mode")
            if key in found.given
        ]
    return found


def translate_ray(mapping: Mapping[str, Any]) -> TranslatedSettings:
    """Return the arguments of `ray.init`; without an address they start a separate Ray for the run."""
    found = _RAY.translate(mapping, "ray_config")
    found.settings = {**run_keys.RAY_DEFAULTS, **found.settings}
    address = found.settings["address"]
    if isinstance(address, str) and not run_keys.RAY_ADDRESS.fullmatch(address):
        hint = "give `local`, `auto`, `HOST:PORT` or `ray://HOST:PORT`"
        message = f"{address!r} is not the address of a Ray cluster"
        found.problems.append(Problem(message, "ray_config.address", hint=hint))
    return found


def translate_policy(mapping: Mapping[str, Any], name: str, algorithm: str) -> TranslatedSettings:
    """Return the settings of one of several policies that learn together.

    Args:
        mapping: RLlib keys of the policy, without those that are the same for all policies.
        name: Name of the policy.
        algorithm: Name of the algorithm.
    """
    path = f"policies.{name}"
    found = _rllib(mapping, path, algorithm)
    for key in found.settings:
        if key not in keys.POLICY_KEYS:
            message = f"`{key}` applies to all policies, so {name} cannot have a separate value"
            hint = f"give all policies the same value; only {', '.join(keys.POLICY_KEYS)} may differ between them"
            found.problems.append(Problem(message, f"{path}.{key}", hint=hint))
        elif is_searched(found.settings[key]):
            message = "only keys that are the same for all policies can be searched"
            found.problems.append(Problem(message, f"{path}.{key}"))
    return found


def _algorithm(mapping: Mapping[str, Any], from_tune: str | None) -> tuple[str, list[Problem]]:
    name = mapping.get("algorithm", mapping.get("run", from_tune or "PPO"))
    if name in keys.ALGORITHMS:
        if from_tune and from_tune != name:
            message = f"rllib_configs names {name}, and tune_config names {from_tune}; remove one"
            return name, [Problem(message, "rllib_configs.algorithm")]
        return name, []
    path = "rllib_configs.algorithm" if "algorithm" in mapping else "tune_config.algorithm"
    hint = f"use one of {', '.join(f'`{known}`' for known in keys.ALGORITHMS)}"
    problem = Problem(f"no algorithm of RLlib is called `{name}`", path, hint=hint)
    return "PPO", [problem]


def _rllib(mapping: Mapping[str, Any], path: str, algorithm: str, nested: bool = False) -> TranslatedSettings:
    """Translate RLlib's keys, including those nested in `model_config` and `evaluation_config`."""
    own = keys.ALGORITHM_KEYS.get(algorithm)
    tables = KeyTables(
        {**keys.COMMON_KEYS, **({} if nested else keys.OWN_KEYS), **(own or {})},
        old_keys.RENAMED,
        old_keys.DROPPED,
        old_keys.ONLY_AT,
        _REFUSED,
        old_keys.SPELLINGS,
        unchecked=keys_of_release()[algorithm],
        searchable=not nested,
    )
    found = tables.translate(mapping, path)
    settings, problems = found.settings, found.problems
    problems += _hidden_searches(mapping, path)
    if isinstance(settings.get("model_config"), Mapping):
        model_path = f"{path}.{'model' if 'model' in mapping else 'model_config'}"
        model = _MODEL.translate(settings["model_config"], model_path)
        model.problems[:0] = _hidden_searches(model.settings, model_path)
        found.nest("model_config", model)
        if algorithm != "PPO":
            own_keys = [key for key in model.settings if key in keys.FRESH_KEYS]
            if own_keys:
                named = ", ".join(f"`{key}`" for key in own_keys)
                message = f"only PPO has the key{'s' * (len(own_keys) > 1)} {named}"
                hint = f"remove {'them' if len(own_keys) > 1 else 'it'}{_instead(algorithm)}"
                problems.append(Problem(message, f"{model_path}.{own_keys[0]}", hint=hint))
        if model.settings.get("use_lstm") and algorithm == "SAC":
            message = "RLlib's SAC has no recurrent policies"
            problems.append(Problem(message, f"{model_path}.use_lstm", hint="remove it, or use PPO"))
        elif model.settings.get("use_lstm") and model.settings.get("free_log_std"):
            message = "RLlib's recurrent policies do not support `free_log_std`"
            problems.append(Problem(message, f"{model_path}.free_log_std", hint="remove it or `use_lstm`"))
    if isinstance(settings.get("evaluation_config"), Mapping):
        evaluation = _rllib(settings["evaluation_config"], f"{path}.evaluation_config", algorithm, True)
        found.nest("evaluation_config", evaluation)
    return found


def _instead(algorithm: str) -> str:
    """Return a hint how to use another algorithm's policy file; empty if there is none."""
    file = f"configs/learners/{algorithm.lower()}.yml"
    return f", or replace the whole policy: 'policy=!include {file}'" if algorithm in ("APPO", "SAC", "DQN") else ""


def _hidden_searches(mapping: Mapping[str, Any], path: str) -> list[Problem]:
    """Return a problem for each value inside which Tune would resolve a search: it searches every mapping and list."""
    problems = []
    for given, value in mapping.items():
        if current_name(str(given)) in ("model_config", "evaluation_config"):
            continue  # the keys of these mappings are checked separately
        word = next(filter(None, map(_resolved_by_tune, _named_values(value))), "")
        message = f"`{word}` is only supported for the keys of `rllib_configs` themselves"
        if word == _EVAL:
            message = "`eval` contains code, which Tune would run; give the value itself"
        if word:
            problems.append(Problem(message, f"{path}.{given}"))
    return problems


def _named_values(value: Any) -> list[Any]:
    """Return the values listed in a search, including the ends of a range; a list of the value itself if it is none."""
    given = next(iter(value.values())) if is_searched(value) else [value]
    return list(given) if isinstance(given, list | tuple) else [given]


def _resolved_by_tune(value: Any) -> str:
    """Return the first keyword that Tune would resolve at any depth of a value (a search or `eval`); empty if none."""
    if isinstance(value, Mapping):
        if is_searched(value) or set(value) == {_EVAL}:
            return str(next(iter(value)))
        value = value.values()
    elif not isinstance(value, list | tuple):
        return ""
    return next(filter(None, map(_resolved_by_tune, value)), "")


def _above(limit: float) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, int | float) and value > limit


#: For each key: a predicate for the values that need RLlib's stock runner or learner, the reason for the runner, and
#: the reason for the learner. An empty reason means that the value does not affect that part.
_STOCK_KEYS: dict[str, tuple[Callable[[Any], bool], str, str]] = {
    "rl_module": (
        bool,
        "the batched runner supports only the package's own policies",
        "the fast learner supports only the package's own policies",
    ),
    "env_to_module_connector": (bool, "there is a connector between environment and policy", ""),
    "module_to_env_connector": (bool, "there is a connector between policy and environment", ""),
    "restart_failed_sub_environments": (bool, "the batched runner does not restart environments that fail", ""),
    "num_learners": (_above(1), "", "several learners share a batch"),
    "torch_compile_learner": (bool, "", "the fast learner is not compiled"),
    "torch_skip_nan_gradients": (lambda value: value is False, "", "each gradient must be checked"),
    "learner_connector": (bool, "", "there is a connector between episodes and learner"),
    "use_critic": (lambda value: value is False, "", "there is no value function"),
    "num_aggregator_actors_per_learner": (_above(0), "", "other processes make the batches"),
}


def _choose_fast_paths(settings: dict[str, Any]) -> tuple[list[str], list[Problem]]:
    """Set `env_runner` and `learner` to ``stock`` where this package's own ones do not support the training.

    Args:
        settings: The settings of the algorithm, which are changed in place.

    Returns:
        Notes for the user, and problems.
    """
    problems = [
        Problem(f"`{key}` sets how to {what} and cannot be searched; give one value", f"rllib_configs.{key}")
        for key, what in (("env_runner", "sample"), ("learner", "compute"), ("learner_threads", "compute"))
        if is_searched(settings[key])
    ]
    if problems:
        return [], problems
    notes, algorithm = [], settings["algorithm"]
    sampling = learning = "the policy is recurrent (`use_lstm`)" if settings["model_config"].get("use_lstm") else ""
    if algorithm not in keys.BATCHED_ALGORITHMS:
        sampling = f"the batched runner supports {', '.join(keys.BATCHED_ALGORITHMS)}, not {algorithm}"
    for key, (needed, runner, learner) in _STOCK_KEYS.items():
        if any(value is not None and needed(value) for value in _named_values(settings.get(key))):
            sampling = sampling or (runner and f"{runner} (`{key}`)")
            learning = learning or (learner and f"{learner} (`{key}`)")
    if sampling and settings["env_runner"] == "batched":
        settings["env_runner"] = "stock"
        notes.append(f"RLlib's stock runner samples: {sampling}")
    whole = settings.get("batch_mode") == "complete_episodes" and settings["num_envs_per_env_runner"] != 1
    if whole and settings["env_runner"] == "stock":
        notes.append(
            "`batch_mode: complete_episodes` discards unfinished episodes and so favours short ones; "
            "`truncate_episodes` uses them"
        )
    if algorithm != "PPO":
        settings["learner"] = "stock"  # the other algorithms have only RLlib's learner
    elif learning and settings["learner"] == "fast":
        settings["learner"] = "stock"
        notes.append(f"RLlib's stock learner learns: {learning}")
    return notes, []


def _fit_batch(settings: dict[str, Any], given: frozenset[str]) -> list[Problem]:
    """Limit the default minibatch size to the batch size, and check that fragments add up to the batch."""
    batch, minibatch = settings.get("train_batch_size_per_learner"), settings.get("minibatch_size")
    problems: list[Problem] = []
    if isinstance(batch, int) and isinstance(minibatch, int) and minibatch > batch:
        if "minibatch_size" in given:
            message = f"a minibatch of {minibatch} is larger than the batch of {batch} (`train_batch_size_per_learner`)"
            problems.append(Problem(message, "rllib_configs.minibatch_size"))
        settings["minibatch_size"] = batch
    fragment = settings.get("rollout_fragment_length", "auto")
    runners, envs = settings["num_env_runners"], settings["num_envs_per_env_runner"]
    if settings["algorithm"] != "PPO" or not all(isinstance(item, int) for item in (fragment, batch, runners, envs)):
        return problems
    total = batch * max(settings.get("num_learners", 0), 1)
    step = max(runners, 1) * envs * fragment
    if -(-total // step) * step - total > 0.1 * total:
        parts = f"fragments of {fragment} steps from {max(runners, 1)} x {envs} environments"
        message = f"a batch of {total} cannot be made of {parts}"
        problems.append(Problem(message, "rllib_configs.rollout_fragment_length", hint="remove it, or use `auto`"))
    return problems
