"""Clusters by scikit-learn's K-means from the same first centres, and a benchmark's plain loop over it."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from sklearn.cluster import KMeans
from sklearn.exceptions import ConvergenceWarning

from safe_inspect.environments import TeamEnvironment
from safe_inspect.geometry.clusters import KMeansRule, RowDraws, cluster_row
from safe_inspect.types import AnyArray

RULE = KMeansRule(points_per_cluster=10, max_iterations=50)


class Clusters(NamedTuple):
    """The arrays of the rows, in the order of the arguments of `cluster_candidates`."""

    centres: AnyArray
    num_centres: AnyArray
    candidates: AnyArray
    settled: AnyArray


def cluster_sklearn(
    points: AnyArray, candidates: AnyArray, clusters: Clusters, draws: RowDraws, rule: KMeansRule
) -> None:
    """Cluster rows as `cluster_candidates` does, with scikit-learn's K-means from the same first centres."""
    centres, count, previous, settled = clusters
    start, work = rule._replace(max_iterations=0), (np.empty(len(points) + 1, np.int64), np.empty((3, len(points))))
    for row in np.flatnonzero(~settled | (candidates != previous).any(axis=1)):
        key, step = draws.key[row], draws.step[row]
        k, _ = cluster_row(points, candidates[row], centres[row], count[row], key, step, start, *work)
        count[row] = k
        converged = True
        if k:
            means = KMeans(k, init=centres[row, :k].copy(), n_init=1, max_iter=rule.max_iterations, tol=0.0)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ConvergenceWarning)  # raised for fewer distinct centres than clusters
                means.fit(points[candidates[row]])
            centres[row, :k] = means.cluster_centers_
            converged = means.n_iter_ < rule.max_iterations and len(np.unique(means.labels_)) == k
        settled[row] = converged
        previous[row] = candidates[row]


class PlainClusters:
    """Clusters of the candidates of an environment's chief, found before a step.

    Args:
        every: Cluster at every step, otherwise only if the candidates have changed.
    """

    def __init__(self, every: bool) -> None:
        self._every, self._clusters = every, None

    def __call__(self, environment: TeamEnvironment) -> None:
        """Cluster the candidates of every row."""
        state, model = environment.state, environment.simulation.world.points["chief"]
        candidates = model.lit(state["sun_direction"]) & (state.points["chief"].inspector < 0)
        if self._clusters is None:
            rows, count = candidates.shape
            centres = np.zeros((rows, -(-count // RULE.points_per_cluster), 3))
            self._clusters = Clusters(centres, np.zeros(rows, np.int64), candidates, np.zeros(rows, np.bool_))
        if self._every:
            self._clusters.settled[...] = False
        cluster_sklearn(model.points, candidates, self._clusters, RowDraws(state.key, state.step), RULE)
