"""Weights for a policy that sees more than the one that they come from, or sees it otherwise."""

import dataclasses

import numpy as np
import pytest
from random_checkpoint import experiment_of, single_run

from safe_inspect.config.elements import ObservedElement
from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.checkpoints import INFO, initial_weights, starting_weights

SOURCE = "burn-and-coast"
FIRST = tuple(f"encoder.{net}_encoder.net.mlp.0." for net in ("actor", "critic"))


@pytest.fixture(scope="module")
def trained():
    return initial_weights(SOURCE)


def model_of(trained, **changes):
    return {INFO: dataclasses.replace(trained.info, **changes).metadata()}


def first_layer(arrays, net, seen):
    return arrays[f"{net}weight"] @ seen + arrays[f"{net}bias"]


def test_a_policy_that_sees_more_does_at_first_what_the_other_does(trained):
    old = trained.info.observation
    other = [ObservedElement("Sensor_Other.x", "m"), ObservedElement("Sensor_Other.y", "m")]
    seen = (old[1], other[0], dataclasses.replace(old[0], centre=30.0, width=20.0), *old[2:], other[1])
    arrays = starting_weights(SOURCE, model_of(trained, observation=seen))

    rng = np.random.default_rng(5)
    values = {element.name: rng.normal(element.centre, 2.0 * element.width) for element in seen}
    before, after = (np.array([(values[e.name] - e.centre) / e.width for e in elements]) for elements in (old, seen))
    for net in FIRST:
        wanted, found = first_layer(trained.arrays, net, before), first_layer(arrays, net, after)
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-4)
        assert not arrays[f"{net}weight"][:, [1, -1]].any()
    untouched = arrays.keys() - {f"{net}{kind}" for net in FIRST for kind in ("weight", "bias")}
    assert untouched
    for name in untouched:
        np.testing.assert_array_equal(arrays[name], trained.arrays[name])


def test_the_same_elements_have_the_same_weights(trained):
    for model in (model_of(trained), {}):
        arrays = starting_weights(SOURCE, model)
        assert all(np.array_equal(arrays[name], value) for name, value in trained.arrays.items())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            lambda info: {"observation": info.observation[1:]},
            r"does not observe Sensor_Position.x \[m\] as that policy does",
        ),
        (
            lambda info: {"observation": (dataclasses.replace(info.observation[0], unit="km"), *info.observation[1:])},
            r"does not observe Sensor_Position.x \[m\]",
        ),
        (
            lambda info: {"action": (dataclasses.replace(info.action[0], gain=0.2), *info.action[1:])},
            "of the actions, X Thrust commands",
        ),
    ],
)
def test_a_policy_that_lacks_something_or_acts_otherwise_is_refused(trained, changes, message):
    with pytest.raises(CheckpointError, match=message):
        starting_weights(SOURCE, model_of(trained, **changes(trained.info)))


def test_a_run_means_its_newest_checkpoint(tmp_path):
    checkpoint = single_run(tmp_path, experiment_of())
    run, own = initial_weights(str(tmp_path)), initial_weights(str(checkpoint))
    assert run.arrays.keys() == own.arrays.keys()
    assert all(np.array_equal(run.arrays[name], value) for name, value in own.arrays.items())
