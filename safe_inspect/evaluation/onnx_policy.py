"""Policies from ONNX files written by `safe-inspect export`, run by onnxruntime without Ray or Torch."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safe_inspect.config.elements import CONTROL_STEPS, element_columns, raw_task
from safe_inspect.config.experiment import build_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import CheckpointError, SafeInspectError
from safe_inspect.evaluation.policies import Flight, require_finite_rows
from safe_inspect.evaluation.policy_file import (
    NEXT_STATE,
    POLICY_FORMAT,
    RECURRENT_FORMAT,
    PolicyInfo,
    check_layout,
    read_file,
)
from safe_inspect.random.action_draws import Categorical, Gaussian, Greedy, Hurdle, draw_choices, draw_in_rollout
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Batches are padded to a multiple of this many rows, so that a row's result does not depend on the batch size.
_ROWS = 16


class OnnxPolicy:
    """A policy of an ONNX file, which maps sensor readings in SI units to the values that the controllers receive.

    If decisions last several control steps, the last value is the index of the duration, which the file gives in
    control steps. The policy works in the task that `prepare` returns. A recurrent policy keeps the state of each row
    between calls, until `begin` or `reset` is called or the number of rows changes.

    Args:
        path: The file.
        info: The metadata of the file.
        session: The onnxruntime session.
        sampled: False: the mean of a Gaussian policy, the most likely level of a categorical policy, and both for a
            hurdle policy. True: actions are sampled from the distribution. None: in a rollout, choices are sampled and
            the size of a burn is its mean. A sample is a function of the seed, the slot, the step and the agent, as in
            training.
        seed: Seed of the samples.

    Attributes:
        path: The file.
        info: The metadata of the file.
        recurrent: Whether the policy keeps a state.
        distribution: The distribution of the actions.
    """

    def __init__(self, path: str, info: PolicyInfo, session: Any, sampled: bool | None = None, seed: int = 0) -> None:
        self.path, self.info = path, info
        self._session = session
        self._sampled, self._seed = sampled, seed
        self._flight: Flight | None = None
        self._steps = 0
        self.recurrent = bool(info.state)
        self._outputs = ("thrust", "action_dist_inputs", *(NEXT_STATE + name for name in info.state))
        self._state: dict[str, AnyArray] = {}
        self._low, self._high, self._gain, self._offset = (
            element_columns(info.action, name) for name in ("low", "high", "gain", "offset")
        )
        self._levels = [np.array(element.levels) for element in info.action]
        self._coasts = bool(info.action) and info.action[-1].unit == CONTROL_STEPS
        # What a controller receives for each choice: a level, or the index of a duration.
        self._choices = [*self._levels[:-1], np.arange(len(self._levels[-1]))] if self._coasts else self._levels
        self.distribution = self._distribution_of()

    def task(self, overrides: Iterable[str] = ()) -> EnvironmentSpec:
        """Return the task in which the policy was trained, before `prepare`.

        Args:
            overrides: ``path.of.keys=value`` for each value of the configuration that is replaced.

        Raises:
            ConfigError: A plugin of the task is missing, or an override is wrong.
        """
        return build_experiment(self.info.configuration, self.path, overrides).spec

    def prepare(self, spec: EnvironmentSpec, agents: Iterable[str] | None = None) -> EnvironmentSpec:
        """Return the task with observations and actions in SI units, which the policy requires.

        Episodes, seeds and physics do not change.

        Args:
            spec: The task.
            agents: Names of the agents that the policy controls; by default all agents without a scripted policy.

        Raises:
            CheckpointError: The task's observations or actions are not those of the file.
            SafeInspectError: There is no such agent.
        """
        chosen = None if agents is None else list(agents)
        raw = raw_task(spec, chosen)
        for agent in spec.controlled:
            if chosen is None or agent.name in chosen:
                check_layout(self.path, self.info, agent)
        return raw

    def begin(self, flight: Flight) -> None:
        """Start episodes in the rows that a flight describes.

        Raises:
            SafeInspectError: The task has not been prepared.
        """
        names = tuple(element.name for element in self.info.observation)
        if flight.observation.names != names or flight.action.choices:
            raise SafeInspectError(f"{self.path}: the task does not match the file; use `policy.prepare(task)`")
        self._flight, self._steps = flight, 0
        self.reset()

    def reset(self, rows: BoolArray | None = None) -> None:
        """Start episodes: set the state of a recurrent policy to zero.

        Args:
            rows: Mask of the rows in which episodes start, shape (R,), with R as in the last call; all rows by default.
        """
        if rows is None:
            self._state = {}
        else:
            self._state = {name: np.where(rows[:, None], np.float32(0.0), held) for name, held in self._state.items()}

    def __call__(self, observation: NDArray[np.float32]) -> FloatArray:
        """Return the values that the controllers receive, shape (R, A), for readings in SI units, shape (R, O).

        Raises:
            ValueError: The observations have another shape, or actions are to be sampled but the rows are unknown.
        """
        step, self._steps = self._steps, self._steps + 1
        return self.decide(observation, slice(None), step)

    def decide(self, observation: NDArray[np.float32], rows: IntArray | slice, step: int) -> FloatArray:
        """Return the values that the controllers receive, shape (Q, A), for readings of some rows, shape (Q, O).

        Args:
            observation: The readings.
            rows: Indices of these rows in the flight, shape (Q,).
            step: Number of the step since `begin`, from 0; samples depend on it.

        Raises:
            ValueError: The observations have another shape, or actions are to be sampled but the rows are unknown.
        """
        thrust, inputs = self.outputs(observation)
        drawn = self._sampled
        if drawn is None:
            drawn = self.info.distribution != "gaussian" and self._flight is not None
            if isinstance(self.distribution, Hurdle):
                inputs = self.distribution.without_noise(inputs)
        if drawn:
            return self._draw(inputs, rows, step)
        found = np.array(thrust, dtype=np.float64)
        for column, (levels, choices) in enumerate(zip(self._levels, self._choices, strict=True)):
            if len(levels):  # the exact levels of the task, which float32 may not represent
                found[:, column] = choices[np.searchsorted((levels[1:] + levels[:-1]) / 2.0, thrust[:, column])]
        return found

    def in_task_units(self, observation: NDArray[np.float32]) -> FloatArray:
        """Return actions (R, A) of the task itself, normalised or as indices of levels, for its observations (R, O).

        Use this for environments that `prepare` has not changed. The readings are rounded to float32 once more.
        """
        values = self(self._readings(observation))
        actions = (values - self._offset) / self._gain
        for column, choices in enumerate(self._choices):
            if len(choices):
                actions[:, column] = np.abs(values[:, column, None] - choices).argmin(axis=1)
        return actions

    def draw(self, observation: NDArray[np.float32], seed: int) -> FloatArray:
        """Return actions (R, A) of the task itself, with sampled choices and mean values of the continuous elements."""
        return draw_choices(self.distribution, self.outputs(self._readings(observation))[1], seed)

    def _readings(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the sensor readings in SI units, shape (R, O), for observations of the task, shape (R, O)."""
        centre, width = (element_columns(self.info.observation, name) for name in ("centre", "width"))
        return np.asarray(observation * width + centre, dtype=np.float32)

    def outputs(self, observation: NDArray[np.float32]) -> tuple[AnyArray, AnyArray]:
        """Return the outputs `thrust` (R, A) and `action_dist_inputs` (R, I) of the file, float32.

        The state of a recurrent policy advances by one step.

        Raises:
            ValueError: The observations have another shape, or contain NaN or infinity.
        """
        observation = np.ascontiguousarray(observation, dtype=np.float32)
        size = len(self.info.observation)
        if observation.ndim != 2 or observation.shape[1] != size:
            raise ValueError(f"expected observations of shape (R, {size}), got {observation.shape}")
        require_finite_rows(observation)
        rows = len(observation)
        missing = -rows % _ROWS if rows else _ROWS
        given = {"observation": observation}
        for name, width in self.info.state.items():
            held = self._state.get(name)
            given[name] = np.zeros((rows, width), np.float32) if held is None or len(held) != rows else held
        given = {name: np.pad(value, ((0, missing), (0, 0))) for name, value in given.items()}
        thrust, inputs, *state = (value[:rows] for value in self._session.run(self._outputs, given))
        self._state = dict(zip(self.info.state, state, strict=True))
        return thrust, inputs

    def _draw(self, inputs: AnyArray, rows: IntArray | slice, step: int) -> FloatArray:
        flight = self._flight
        if flight is None or len(flight.slots[rows]) != len(inputs):
            raise ValueError(
                "a policy that samples its actions needs a call of `begin` with its rows before the first step"
            )
        slots, deputies = flight.slots[rows], flight.deputies[rows]
        drawn = draw_in_rollout(self.distribution, inputs, True, self._seed, slots, deputies, step)
        values = self.commanded(drawn)
        if self._coasts:
            values[:, -1] = drawn[:, -1]
        return values

    def commanded(self, action: FloatArray) -> FloatArray:
        """Return the output `thrust` for actions: numbers as the network gives them, and indices of levels, (R, A)."""
        values = np.minimum(np.maximum(self._offset + self._gain * action, self._low), self._high)
        for column, levels in enumerate(self._levels):
            if len(levels):
                values[:, column] = levels[action[:, column].astype(np.int64)]
        return values

    def _distribution_of(self) -> Gaussian | Categorical | Hurdle:
        width = len(self._levels)
        if self.info.distribution == "hurdle":
            return Hurdle(width - self._coasts, len(self._levels[-1]) if self._coasts else 0)
        if self.info.distribution == "gaussian":
            return Gaussian(width)
        kind = Greedy if self.info.distribution == "greedy" else Categorical
        return kind(tuple(map(len, self._levels)))


def load_onnx(path: str | os.PathLike[str], sampled: bool | None = None, seed: int = 0) -> OnnxPolicy:
    """Return the policy of a file that `safe-inspect export` wrote.

    Args:
        path: The file.
        sampled: Whether actions are sampled from the distribution; see `OnnxPolicy`.
        seed: Seed of the samples.

    Raises:
        CheckpointError: The file is missing or damaged, or was not written by this package.
        SafeInspectError: Onnxruntime is not installed.
    """
    name = os.fspath(path)
    content, sealed = read_file(path)
    # Without this, importing onnxruntime writes a device identifier and a database into the home folder, and a session
    # sends events.
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    try:
        import onnxruntime  # type: ignore[import-untyped,import-not-found]
    except ImportError:
        raise SafeInspectError(
            f"{name}: ONNX files are run by onnxruntime, which is not installed; pip install 'safe_inspect[onnx]'"
        ) from None
    onnxruntime.disable_telemetry_events()  # on Windows
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        metadata = session.get_modelmeta().custom_metadata_map
    except Exception as error:  # onnxruntime raises a different class of error for each kind of damage
        lines = str(error).strip().splitlines()
        raise CheckpointError(
            f"{name}: the file is damaged or not an ONNX file ({lines[0] if lines else type(error).__name__}); "
            "write it again with `safe-inspect export`"
        ) from None
    if "safe_inspect" not in metadata:
        raise CheckpointError(
            f"{name}: the file contains no policy of this package; write one with `safe-inspect export`"
        )
    if not sealed:
        raise CheckpointError(
            f"{name}: the file was damaged or changed after the export; write it again with `safe-inspect export`"
        )
    if metadata.get("format") not in (str(POLICY_FORMAT), str(RECURRENT_FORMAT)):
        raise CheckpointError(
            f"{name}: the file was written by safe_inspect {metadata['safe_inspect']}, whose format this version "
            "cannot read; export the checkpoint again"
        )
    try:
        info = PolicyInfo.of(metadata)
    except (KeyError, ValueError) as error:
        raise CheckpointError(f"{name}: the file's metadata are damaged ({error}); export it again") from None
    return OnnxPolicy(name, info, session, sampled, seed)
