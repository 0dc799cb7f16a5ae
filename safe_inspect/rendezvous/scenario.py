"""What can be wrong with an experiment before anything is flown, though each of its values is right by itself."""

from __future__ import annotations

import numpy as np

from safe_inspect.errors import ConfigError, Problem
from safe_inspect.rendezvous.coordination.context import clearance
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.target.model import Target


def checked_target(config: RendezvousConfig) -> Target:
    """Return the target of an experiment, whose mating point the chaser can be at.

    Raises:
        ConfigError: The target is no rigid body, or its mating point is out of reach at any attitude.
    """
    chaser = config.chaser
    try:
        target: Target = config.target()
        principal = target.principal
    except ValueError as error:
        raise ConfigError(Problem(str(error), "target.config")) from None
    point, path = target.mating_point, "target.config.mating_point"
    distance = float(np.linalg.norm(point))
    if not np.isfinite(principal).all() or not distance > 0.0:
        raise ConfigError(Problem("the mating point is the target's centre of mass", path, hint="give a point outside"))
    spare = float(target.boxes.distance((target.R_MT @ point)[None])[0]) - chaser.radius
    if spare < 0.0:
        raise ConfigError(
            Problem(
                f"the chaser, a sphere of {chaser.radius:g} m, would overlap the target by {-spare:.3g} m there",
                path,
                hint="move the point outwards",
            )
        )
    box = chaser.limits.keep_in
    if box is not None and distance > np.linalg.norm(box):
        raise ConfigError(
            Problem(
                f"the point is {distance:.3g} m from the centre of mass, and no corner of the keep-in box so far",
                path,
                hint="move the point inwards, or enlarge chaser.limits.keep_in",
            )
        )
    return target


def check_start(config: RendezvousConfig, target: Target, orientation: np.ndarray) -> None:
    """Check that the chaser does not touch the target at the start.

    Args:
        config: The experiment.
        target: Its target.
        orientation: The target's attitude q_WT at the start, shape (4,).

    Raises:
        ConfigError: It does.
    """
    body = BodyState(np.zeros(3), np.zeros(3), orientation, np.zeros(3))
    spare = clearance(target, np.array(config.chaser.position), body, config.chaser.radius)
    if spare < 0.0:
        message = f"the chaser would overlap the target by {-spare:.3g} m at the start"
        raise ConfigError(Problem(message, "chaser.position", hint="start farther away"))
