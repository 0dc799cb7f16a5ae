from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from safe_inspect.glues.normalizers import LinearNormalizer, Normalization, StandardNormalNormalizer
from safe_inspect.plugins.functor import errors_of

NONE = np.array([-np.inf]), np.array([np.inf])


def test_standard_normal():
    normalizer = StandardNormalNormalizer(mu=(1.0, 2.0), sigma=(10.0, 0.5))
    values = np.array([[11.0, 2.0], [1.0, 3.0]])
    np.testing.assert_array_equal(normalizer(values, *NONE), [[1.0, 0.0], [0.0, 2.0]])
    np.testing.assert_array_equal(StandardNormalNormalizer(sigma=4.0)(values, *NONE), values / 4.0)


def test_linear():
    low, high = np.array([0.0, -2.0]), np.array([10.0, 2.0])
    values = np.array([[0.0, -2.0], [5.0, 0.0], [10.0, 2.0]])
    np.testing.assert_array_equal(LinearNormalizer()(values, low, high), [[-1, -1], [0, 0], [1, 1]])
    scaled = LinearNormalizer(minimum=0.0, maximum=4.0)(values, low, high)
    np.testing.assert_array_equal(scaled, [[0, 0], [2, 2], [4, 4]])


@settings(max_examples=50, deadline=None)
@given(
    st.floats(-1e3, 1e3), st.floats(-100, 100), st.floats(0.01, 100), st.floats(-50, 0), st.floats(0.1, 50),
)  # fmt: skip
def test_the_inverse_undoes(value, mu, sigma, low, width):
    values, bounds = np.array([[value]]), (np.array([low]), np.array([low + width]))
    for normalizer in (StandardNormalNormalizer(mu=mu, sigma=sigma), LinearNormalizer(minimum=-3.0, maximum=2.0)):
        there = normalizer(values, *bounds)
        np.testing.assert_allclose(normalizer.inverse(there, *bounds), values, rtol=1e-9, atol=1e-9)


def test_what_does_not_fit():
    with pytest.raises(ValueError, match="2 elements"):
        StandardNormalNormalizer(sigma=(1.0, 2.0)).check(3, *NONE)
    StandardNormalNormalizer(sigma=(1.0,)).check(3, *NONE)
    with pytest.raises(ValueError, match="without bounds"):
        LinearNormalizer().check(1, *NONE)


@pytest.mark.parametrize("sigma", [0.0, -1.0, (1.0, 0.0)])
def test_a_deviation_is_positive(sigma):
    with pytest.raises(ValidationError, match="above 0"):
        StandardNormalNormalizer(sigma=sigma)


def test_a_mapping_onto_nothing_is_refused():
    with pytest.raises(ValidationError, match="must be below"):
        LinearNormalizer(minimum=1.0, maximum=1.0)


def test_the_block_of_a_glue():
    assert Normalization(enabled=False).active is None
    assert Normalization().active == LinearNormalizer()
    peer = "corl.libraries.normalization.StandardNormalNormalizer"
    block = Normalization(normalizer=peer, config={"mu": 0.0, "sigma": [100, 100, 100]})
    assert block.active == StandardNormalNormalizer(mu=0.0, sigma=(100.0, 100.0, 100.0))


@pytest.mark.parametrize(
    ("block", "place", "words"),
    [
        ({"normalizer": "LinearNormaliser"}, "normalizer", "did you mean `LinearNormalizer`"),
        ({"normalizer": "StandardNormalNormalizer", "config": {"sigam": 1}}, "config.sigam", "did you mean `sigma`"),
        ({"normalizer": "StandardNormalNormalizer", "config": {"sigma": 0}}, "config.sigma", "above 0"),
        ({"enable": False}, "enable", ""),
    ],
)
def test_mistakes_in_the_block(block, place, words):
    with pytest.raises(ValidationError) as caught:
        Normalization.model_validate(block)
    (error,) = errors_of(caught.value)
    assert ".".join(map(str, error["loc"])) == place
    assert words in error["msg"]
