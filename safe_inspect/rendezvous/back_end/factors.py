"""The factors of the graph, by those of gtsam."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.rendezvous.edges import Edge
from safe_inspect.rendezvous.libraries import require
from safe_inspect.types import FloatArray


def key(letter: str, index: int = 0) -> int:
    """Return the key of a variable.

    X T_WB, V velocity in W, B bias, G T_GB and Y the centre of mass in B, of each frame; O the centre of mass in G, P
    that in W, M T_GM and Z the centre of mass in M.
    """
    return int(require("gtsam").symbol(letter.lower(), index))


def edge_noise(covariance: FloatArray, huber: float) -> Any:
    """Return the noise of a relative pose, with Huber's weight."""
    models = require("gtsam").noiseModel
    gaussian = models.Gaussian.Covariance(np.ascontiguousarray(covariance))
    return models.Robust.Create(models.mEstimator.Huber.Create(huber), gaussian)


def edge_factor(edge: Edge, first: int, second: int, huber: float) -> Any:
    """Return ``T_ij = G_i^-1 G_j`` as a factor between two keys."""
    gtsam = require("gtsam")
    return gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(edge.pose), edge_noise(edge.covariance, huber))


def rotation_kinematic_factors(frame: int, sigma: float) -> list[Any]:
    """Return ``X^-1 p_W - G^-1 o = 0`` of one frame: the target turns about a centre that rests in W.

    By an auxiliary point y, the centre in B: ``X y = p_W`` and ``G y = o``, each with sigma / sqrt(2); eliminating y
    gives the factor above with sigma.

    Source:
        Setterfield et al., "Mapping and determining the center of mass of a rotating object using a moving observer",
        IJRR 37 (2018).
    """
    gtsam = require("gtsam")
    noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma / np.sqrt(2.0))
    y = key("Y", frame)
    return [
        gtsam.ReferenceFrameFactorPoint3Pose3(y, key("X", frame), key("P"), noise),
        gtsam.ReferenceFrameFactorPoint3Pose3(y, key("G", frame), key("O"), noise),
    ]


def model_centre_factors(sigma: float) -> list[Any]:
    """Return ``o = T_GM z`` and ``z = 0``: the model's origin is the centre of mass."""
    gtsam = require("gtsam")
    noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma)
    return [
        gtsam.ReferenceFrameFactorPoint3Pose3(key("Z"), key("M"), key("O"), noise),
        gtsam.PriorFactorPoint3(key("Z"), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, sigma)),
    ]
