"""Factors of the graph, made of factors of gtsam."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.rendezvous.edges import Edge
from safe_inspect.rendezvous.libraries import require
from safe_inspect.types import FloatArray


def key(letter: str, index: int = 0) -> int:
    """Return the key of a variable.

    Variables of each frame: X is T_WB, V the velocity in W, B the bias, G the pose T_GB and Y the centre of mass in B.
    Constant variables: O is the centre of mass in G, P that in W, M the pose T_GM and Z the centre of mass in M.
    """
    return int(require("gtsam").symbol(letter.lower(), index))


def edge_noise(covariance: FloatArray, huber: float) -> Any:
    """Return the noise model of a relative pose, with Huber's weights."""
    models = require("gtsam").noiseModel
    gaussian = models.Gaussian.Covariance(np.ascontiguousarray(covariance))
    return models.Robust.Create(models.mEstimator.Huber.Create(huber), gaussian)


def edge_factor(edge: Edge, first: int, second: int, huber: float) -> Any:
    """Return ``T_ij = G_i^-1 G_j`` as a factor between two keys."""
    gtsam = require("gtsam")
    return gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(edge.pose), edge_noise(edge.covariance, huber))


def rotation_kinematic_factors(frame: int, sigma: float) -> list[Any]:
    """Return ``X^-1 p_W - G^-1 o = 0`` for one frame: the target rotates about a centre that is at rest in W.

    It is expressed with an auxiliary point y, the centre in B: ``X y = p_W`` and ``G y = o``, each with
    sigma / sqrt(2). Eliminating y gives the factor above with sigma.

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
    """Return factors for ``o = T_GM z`` and ``z = 0``: the model's origin is the centre of mass."""
    gtsam = require("gtsam")
    noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma)
    return [
        gtsam.ReferenceFrameFactorPoint3Pose3(key("Z"), key("M"), key("O"), noise),
        gtsam.PriorFactorPoint3(key("Z"), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, sigma)),
    ]
