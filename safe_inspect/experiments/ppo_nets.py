"""What of a policy's module learns: its nets as functions of a minibatch, with the optimiser of their parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.columns import Columns

from safe_inspect.experiments.fast_tanh import with_fast_tanh

#: Inputs of the action distribution, and values; None where a net does not give them.
Outputs = tuple[torch.Tensor | None, torch.Tensor | None]

_PROBE = 16
_ROUNDING = 1e-5  # of the fast tanh, through some layers


@dataclass(frozen=True)
class Net:
    """A part of a module that shares no parameter with the others, and so learns by itself.

    Attributes:
        forward: Function of observations (B, O).
        parameters: Its parameters that learn.
    """

    forward: Callable[[torch.Tensor], Outputs]
    parameters: Sequence[torch.nn.Parameter]


def nets_of(module: Any, together: bool = False) -> list[Net]:
    """Return a module's nets: policy and value function where they are separate, else one that gives both.

    Args:
        module: RLlib's module of the policy.
        together: One net is wanted in any case.
    """
    whole = _whole(module)
    if together:
        return [whole]
    try:
        parts = _parts(module)
    except AttributeError:
        return [whole]
    known = [id(parameter) for part in parts for parameter in part.parameters]
    if len(set(known)) < len(known) or set(known) != {id(parameter) for parameter in whole.parameters}:
        return [whole]
    size = int(module.observation_space.shape[0])
    probe = torch.linspace(-2.0, 2.0, _PROBE * size).reshape(_PROBE, size)
    with torch.no_grad():
        wanted = whole.forward(probe)
        found = (parts[0].forward(probe)[0], parts[1].forward(probe)[1])
    pairs = zip(wanted, found, strict=True)
    if all(a is not None and b is not None and torch.allclose(a, b, 1e-5, _ROUNDING) for a, b in pairs):
        return parts
    return [whole]


def _whole(module: Any) -> Net:
    def forward(observations: torch.Tensor) -> Outputs:
        batch = {Columns.OBS: observations}
        outputs = module.forward_train(batch)
        values = module.compute_values(batch, embeddings=outputs.get(Columns.EMBEDDINGS))
        return outputs[Columns.ACTION_DIST_INPUTS], values

    return Net(forward, _learning(module))


def _parts(module: Any) -> list[Net]:
    """Return policy and value function of RLlib's own module without its dictionaries about the layers."""
    ours = DefaultPPOTorchRLModule
    names = ("forward_train", "_forward_train", "compute_values")
    if not isinstance(module, ours) or any(getattr(type(module), name) is not getattr(ours, name) for name in names):
        raise AttributeError("not RLlib's own")
    actor, critic = module.encoder.actor_encoder.net.mlp, module.encoder.critic_encoder.net.mlp
    pi, vf, act, judge = module.pi, module.vf, with_fast_tanh(actor), with_fast_tanh(critic)
    return [
        Net(lambda batch: (pi(act(batch)), None), [*_learning(actor), *_learning(pi)]),
        Net(lambda batch: (None, vf(judge(batch)).squeeze(-1)), [*_learning(critic), *_learning(vf)]),
    ]


def _learning(module: Any) -> list[torch.nn.Parameter]:
    return [parameter for parameter in module.parameters() if parameter.requires_grad]


def part_of(optimiser: Any, parameters: Sequence[torch.nn.Parameter]) -> torch.optim.Adam:
    """Return an optimiser of some of the parameters of another, whose settings and state it shares.

    RLlib has one for all parameters of a module, and it is that one which checkpoints hold.
    """
    (group,) = optimiser.param_groups
    names = ("lr", "betas", "eps", "weight_decay", "amsgrad", "maximize")
    part = torch.optim.Adam(parameters, **{name: group[name] for name in names}, fused=True)
    for parameter in parameters:
        state = optimiser.state[parameter]
        if not state:
            state["step"] = torch.zeros((), dtype=torch.float32, device=parameter.device)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
        part.state[parameter] = state
    return part
