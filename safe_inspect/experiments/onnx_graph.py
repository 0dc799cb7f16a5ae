"""Conversion of a policy to an ONNX file by `torch.onnx`. Importing this module loads Ray and Torch, but not `onnx`."""

from __future__ import annotations

import copy
import logging
import warnings
from typing import Any

import numpy as np
import torch
from ray.rllib.core.columns import Columns
from ray.rllib.core.models.base import ACTOR, CRITIC
from ray.rllib.core.models.torch.heads import TorchFreeLogStdMLPHead

from safe_inspect.config.elements import element_columns
from safe_inspect.errors import CheckpointError, SafeInspectError
from safe_inspect.evaluation.policy_file import NEXT_STATE, PolicyInfo
from safe_inspect.experiments.modules.saved_policy import DqnPolicy, SacPolicy
from safe_inspect.types import FloatArray
from safe_inspect.version import __version__

#: Logarithm of the standard deviation of a deterministic policy; samples equal the mean to all digits.
NO_SPREAD = -20.0
#: Names of an ONNX file's inputs for the state of an LSTM: output and cell.
STATE = ("state_h", "state_c")
#: Version of ONNX; runtimes since 2023 support it.
OPSET = 18


class Spread(torch.nn.Module):
    """Layer that appends the logarithms of fixed standard deviations to means.

    Args:
        log_std: The logarithms, shape (A,).
    """

    def __init__(self, log_std: torch.Tensor) -> None:
        super().__init__()
        self.log_std = log_std.detach()

    def forward(self, mean: torch.Tensor) -> torch.Tensor:
        """Return means and logarithms, shape (R, 2 A)."""
        return torch.cat((mean, self.log_std.expand_as(mean)), dim=1)


class RllibNet(torch.nn.Module):
    """Function of a policy of RLlib, from observations and the state of an LSTM to the inputs of its distribution.

    Of SAC it gives the mode, tanh(mean), because the files cannot describe the squashed Gaussian from which SAC samples
    its actions; of DQN the values of the choices.

    Args:
        module: The policy.
        title: Name of the checkpoint in messages.

    Attributes:
        state: The sizes of the inputs of `STATE`; empty for a policy without a state.

    Raises:
        CheckpointError: The state is not that of one LSTM, or DQN has learned a distribution of returns.
    """

    def __init__(self, module: Any, title: str) -> None:
        super().__init__()
        self.module, self.state = copy.deepcopy(module).eval(), {}
        head = getattr(module, "pi", None)
        if type(head) is TorchFreeLogStdMLPHead:  # repeats the deviations for the number of rows of the example
            limit = float(head.log_std_clip_param_const) if head.clip_log_std else np.inf
            self.module.pi = torch.nn.Sequential(head.net, Spread(head.log_std.clamp(-limit, limit)))
        space: Any = module.action_space
        self._mode_of: int | None = space.shape[0] if isinstance(module, SacPolicy) else None
        if isinstance(module, DqnPolicy) and module.num_atoms > 1:
            raise CheckpointError(
                f"{title}: the policy has learned a distribution of returns (`num_atoms`); train without it"
            )
        if module.is_stateful():
            start = module.get_initial_state()
            self._separate = ACTOR in start  # the value function has another encoder
            start = start.get(ACTOR, start)
            if start.keys() != {"h", "c"} or {tuple(part.shape[:-1]) for part in start.values()} != {(1,)}:
                raise CheckpointError(f"{title}: the policy has another state than RLlib's LSTM of one layer")
            self.state = dict.fromkeys(STATE, int(start["h"].shape[-1]))

    def forward(self, observation: torch.Tensor, *state: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return the inputs of the distribution, shape (R, I), and the next state, two of shape (R, H)."""
        batch: dict[str, Any] = {Columns.OBS: observation}
        if state:
            held = {name: part[:, None] for name, part in zip("hc", state, strict=True)}
            before = {ACTOR: held, CRITIC: held} if self._separate else held
            batch = {Columns.OBS: observation[:, None], Columns.STATE_IN: before}
        found = self.module.forward_inference(batch)
        inputs = found[Columns.ACTION_DIST_INPUTS]
        if state:
            after = found[Columns.STATE_OUT].get(ACTOR, found[Columns.STATE_OUT])
            inputs = inputs[:, 0]
        if self._mode_of is not None:
            mode = torch.tanh(inputs[:, : self._mode_of])
            inputs = torch.cat((mode, torch.full_like(mode, NO_SPREAD)), dim=1)
        return (inputs, *(after[name][:, 0] for name in "hc" if state))


class _WholePolicy(torch.nn.Module):
    """A net with the normalisation of its observation and the commands of its actions."""

    def __init__(self, net: torch.nn.Module, info: PolicyInfo) -> None:
        super().__init__()
        self._net, self._gates = net, int(info.distribution == "hurdle")
        numbers = [element for element in info.action if not element.levels]
        self._levels = [torch.tensor(element.levels) for element in info.action[len(numbers) :]]
        self._numbers = len(numbers)
        self._centre, self._width = (_float32(element_columns(info.observation, name)) for name in ("centre", "width"))
        self._gain, self._offset, self._low, self._high = (
            _float32(element_columns(numbers, name)) for name in ("gain", "offset", "low", "high")
        )

    def forward(self, observation: torch.Tensor, *state: torch.Tensor) -> tuple[torch.Tensor, ...]:
        """Return the commands, the inputs of the distribution, and the next state."""
        found = self._net((observation - self._centre) / self._width, *state)
        inputs, *after = found if isinstance(found, tuple) else (found,)
        first = self._gates + self._numbers
        value = inputs[:, self._gates : first]
        if self._gates:  # the mean of a hurdle policy is 0 where its logit is not positive
            value = torch.where(inputs[:, :1] > 0.0, value, 0.0)
        parts = [torch.minimum(torch.maximum(self._offset + self._gain * value, self._low), self._high)]
        first += self._numbers
        for levels in self._levels:
            parts.append(levels[inputs[:, first : first + len(levels)].argmax(dim=1, keepdim=True)])
            first += len(levels)
        return torch.cat(parts if self._numbers else parts[1:], dim=1), inputs, *after


def _float32(values: FloatArray) -> torch.Tensor:
    return torch.as_tensor(values, dtype=torch.float32)


def require_onnx() -> Any:
    """Return the module `onnx`.

    Raises:
        SafeInspectError: The package onnx or onnxscript is not installed.
    """
    try:
        import onnx  # type: ignore[import-untyped,import-not-found,unused-ignore]
        import onnxscript  # type: ignore[import-untyped,import-not-found,unused-ignore]  # noqa: F401  # for torch.onnx
    except ImportError as error:
        raise SafeInspectError(
            f"ONNX files are written by the package {error.name}, which is not installed; pip install "
            "'safe_inspect[onnx]'"
        ) from None
    return onnx


def build_file(net: torch.nn.Module, info: PolicyInfo, title: str) -> bytes:
    """Return the bytes of the ONNX file of a policy, without its seal.

    Args:
        net: The net, from normalised observations and the state to the inputs of the distribution and the next state.
        info: The description of the policy for the file.
        title: Name of the checkpoint in messages.

    Raises:
        CheckpointError: Torch cannot export the net.
        SafeInspectError: The package onnx or onnxscript is not installed.
    """
    onnx = require_onnx()
    rows = {0: torch.export.Dim("N")}
    example = torch.zeros(2, len(info.observation))
    state = [torch.zeros(2, size) for size in info.state.values()]
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():  # of Torch's own deprecations
        warnings.simplefilter("ignore")
        try:
            program = torch.onnx.export(
                _WholePolicy(net, info).eval(),
                (example, *state),
                input_names=["observation", *info.state],
                output_names=["thrust", "action_dist_inputs", *(NEXT_STATE + name for name in info.state)],
                opset_version=OPSET,
                dynamic_shapes=(rows, tuple(rows for _ in state)) if state else (rows,),
                dynamo=True,
                verbose=False,
            )
        except Exception as error:  # Torch raises many kinds of errors for nets that it cannot export
            reason = str(error.__cause__ or error).strip().partition("\n")[0]
            raise CheckpointError(f"{title}: the policy cannot be exported by torch.onnx ({reason})") from None
    assert program is not None, "torch.onnx must return the program"
    model = program.model_proto
    graph = model.graph
    for part in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info, *graph.initializer):
        part.ClearField("metadata_props")  # places in this machine's sources
    model.producer_name, model.producer_version = "safe_inspect", __version__
    onnx.helper.set_model_props(model, info.metadata())
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content
