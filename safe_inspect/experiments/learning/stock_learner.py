"""What only RLlib's stock PPO learner can do. Importing this module loads Ray and Torch."""

from __future__ import annotations

from typing import Any

import torch
from ray.rllib.core.rl_module.apis.self_supervised_loss_api import SelfSupervisedLossAPI
from ray.rllib.core.rl_module.apis.value_function_api import ValueFunctionAPI

from safe_inspect.experiments.modules.distributions import distribution_of_module


def why_stock_learner(config: Any) -> str:
    """Return why a configuration of RLlib needs the stock learner; empty when the fast one serves it."""
    if config._learner_connector is not None or not config.add_default_connectors_to_learner_pipeline:
        return "a connector stands between episodes and learner"
    if config.num_learners > 1:
        return "several learners share a batch"
    if config.torch_compile_learner:
        return "the learner is compiled"
    if config._torch_grad_scaler_class or config._torch_lr_scheduler_classes:
        return "Torch scales gradients or schedules learning rates"
    return ""


def why_not_learned(learner: Any, name: str) -> str:
    """Return why a policy needs the stock learner.

    Args:
        learner: RLlib's learner.
        name: Name of the policy.
    """
    module: Any = learner.module[name].unwrapped()
    if module.is_stateful():
        return f"the policy {name} is recurrent"
    if isinstance(module, SelfSupervisedLossAPI):
        return f"the policy {name} has a loss of its own"
    judges: bool = isinstance(module, ValueFunctionAPI)
    if not judges or not learner.config.get_config_for_module(name).use_critic:
        return f"the policy {name} has no value function"
    if distribution_of_module(module) is None:
        return f"the actions of the policy {name} are neither Gaussian nor categorical"
    optimisers = [optimiser for _, optimiser in learner.get_optimizers_for_module(name)]
    if [type(optimiser) for optimiser in optimisers] != [torch.optim.Adam] or len(optimisers[0].param_groups) != 1:
        return f"the policy {name} has another optimiser than Adam"
    return ""
