"""Replay of a mission from its files: run the commands again and compare the motion with the log."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from safe_inspect.rendezvous.coordination.context import clearances
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.missions.record import read_mission
from safe_inspect.rendezvous.truth import ChaserFlight, target_motion
from safe_inspect.types import FloatArray


class Replay(NamedTuple):
    """The motion of a replayed mission.

    Attributes:
        time: Times of the ticks [s], shape (K,).
        translation: Position [m] and velocity [m/s] of the chaser in W, shape (K, 6).
        orientation: Attitude q_WB of the chaser, shape (K, 4).
        target: Attitude q_WT of the target, shape (K, 4).
        clearance: Distance of the chaser's sphere to the target's boxes [m], shape (K,).
        translation_difference: Largest difference of a component of `translation` from the log [m, m/s].
        orientation_difference: Largest difference of a component of q_WB from the log.
        clearance_difference: Largest difference of the least clearance of a control step from the log [m].
    """

    time: FloatArray
    translation: FloatArray
    orientation: FloatArray
    target: FloatArray
    clearance: FloatArray
    translation_difference: float
    orientation_difference: float
    clearance_difference: float


def replay(folder: str | os.PathLike[str]) -> Replay:
    """Run the commands of a mission's log again from the logged initial state.

    Raises:
        CheckpointError: A file is missing or damaged.
    """
    record = read_mission(folder)
    config, target, logged = record.config, record.target, record.arrays
    mission = config.mission
    steps, ticks = len(logged["t"]), mission.control_ticks
    start = BodyState(logged["x"][0, :3], logged["x"][0, 3:], logged["q"][0], logged["w"][0])
    flight = ChaserFlight(config, start)
    parts = [flight.step(flown[:3], flown[3:])[0] for flown in logged["flown"]]
    translation = np.concatenate([np.hstack((part.position, part.velocity)) for part in parts])
    orientation = np.concatenate([part.orientation for part in parts])
    time = mission.tick * np.arange(1, steps * ticks + 1)
    at_start = (logged["target_q"][0], logged["target_w"][0])
    q, _ = target_motion(target.principal, at_start, mission.impulses, time)
    clearance = clearances(target, translation[:, :3], q, config.chaser.radius)
    after = slice(ticks - 1, -1, ticks)  # The log contains the states before each step.
    return Replay(
        time,
        translation,
        orientation,
        q,
        clearance,
        float(np.abs(translation[after] - logged["x"][1:]).max(initial=0.0)),
        float(np.abs(orientation[after] - logged["q"][1:]).max(initial=0.0)),
        float(np.abs(clearance.reshape(steps, ticks).min(axis=1) - logged["clearance"]).max()),
    )
