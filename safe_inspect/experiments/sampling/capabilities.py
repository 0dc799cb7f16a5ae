"""`capabilities`: what the batched runner and the fast learner can do. Importing this module loads Ray and Torch."""

from __future__ import annotations

from functools import partial
from typing import Any

from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.core.rl_module.apis.self_supervised_loss_api import SelfSupervisedLossAPI
from ray.rllib.core.rl_module.apis.value_function_api import ValueFunctionAPI
from ray.rllib.utils import force_list

from safe_inspect.experiments.modules.distributions import distribution_of_module
from safe_inspect.experiments.sampling.callbacks import RunCallbacks
from safe_inspect.experiments.settings.capabilities import Capabilities, capabilities_by_keys

_HOOKS = ("on_episode_created", "on_episode_start", "on_episode_step", "on_episode_end")
#: Keys whose attribute in `AlgorithmConfig` begins with an underscore, or which are methods there.
_PRIVATE = ("env_to_module_connector", "module_to_env_connector", "learner_connector")


def capabilities(config: Any, module: Any = None) -> Capabilities:
    """Return why a training needs RLlib's stock runner or learner; reasons are empty if this package's own can be used.

    Args:
        config: RLlib's configuration.
        module: RLlib's module of a policy; None to check only the configuration.
    """
    found = capabilities_by_keys(partial(_value, config))
    return Capabilities(
        found.sampling or _why_stock_runner(config) or ("" if module is None else _why_not_sampled(module)),
        found.learning or _why_stock_learner(config) or ("" if module is None else _why_not_learned(module)),
    )


def _value(config: Any, key: str) -> Any:
    """Return the value in RLlib's configuration of a key of `rllib_configs`."""
    if key == "algorithm":
        return getattr(config.algo_class, "__name__", "")
    if key in _PRIVATE:
        return getattr(config, f"_{key}")
    return None if key == "rl_module" else getattr(config, key, None)  # the module itself is checked


def _why_stock_runner(config: Any) -> str:
    for hook in _HOOKS:
        own = any(
            getattr(kind, hook, None) is not getattr(RLlibCallback, hook)
            for kind in force_list(config.callbacks_class)
            if isinstance(kind, type) and not issubclass(RunCallbacks, kind)
        )
        if own or getattr(config, f"callbacks_{hook}"):
            return f"a callback implements `{hook}`"
    return "steps are counted as agent steps" if config.count_steps_by != "env_steps" else ""


def _why_stock_learner(config: Any) -> str:
    if not config.add_default_connectors_to_learner_pipeline:
        return "there is a connector between episodes and learner"
    if config._torch_grad_scaler_class or config._torch_lr_scheduler_classes:
        return "Torch scales gradients or schedules learning rates"
    return ""


def _why_not_sampled(module: Any) -> str:
    if module.is_stateful():
        return "the policy is recurrent"
    return "the policy's actions are neither Gaussian nor categorical" if distribution_of_module(module) is None else ""


def _why_not_learned(module: Any) -> str:
    if isinstance(module, SelfSupervisedLossAPI):
        return "the policy defines its own loss"
    if not isinstance(module, ValueFunctionAPI):
        return "the policy has no value function"
    return _why_not_sampled(module)
