"""How much of the returns the critic explains, as scikit-learn computes it."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.metrics import explained_variance_score

from safe_inspect.experiments.learning.ppo_nets import _explained


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 1.0])
def test_it_is_the_explained_variance(share):
    numbers = np.random.default_rng(5)
    targets = numbers.normal(3.0, 2.0, 500).astype(np.float32)
    values = (share * targets + (1.0 - share) * 0.5 * numbers.normal(3.0, 2.0, 500)).astype(np.float32)
    assert _explained(targets, values) == pytest.approx(explained_variance_score(targets, values), abs=1e-5)


def test_it_is_minus_one_at_least():
    targets = np.linspace(0.0, 1.0, 11, dtype=np.float32)
    assert _explained(targets, -9.0 * targets) == -1.0
    assert _explained(np.ones(4, np.float32), np.ones(4, np.float32)) == -1.0
