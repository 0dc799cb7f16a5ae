"""A file of open-loop optima is read for the episodes that it has, and for no others."""

from __future__ import annotations

import json

import numpy as np
import pytest

from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.baselines import read_reference

VALUES = [1.5, None, 3.0, 0.25]
TASK = {"horizon": 5, "physics": {"mass": 12.0}}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "plans.json"
    path.write_text(json.dumps({"seed": 7, "delta_v": VALUES, "task": TASK}))
    return path


@pytest.mark.parametrize("episodes", [1, 2, 3, 4])
def test_the_first_episodes_have_the_values_of_the_file(file, episodes):
    wanted = np.array([np.nan if value is None else value for value in VALUES[:episodes]])
    np.testing.assert_array_equal(read_reference(file, 7, episodes), wanted)
    np.testing.assert_array_equal(read_reference(file, 7, episodes, TASK), wanted)


@pytest.mark.parametrize(
    ("seed", "episodes", "task", "message"),
    [
        (7, 5, None, "has 4 episodes, fewer than 5; give --episodes 4"),
        (8, 4, None, "has seed 7, not 8; give --seed 7"),
        (7, 4, {**TASK, "horizon": 6}, "of another task, which differs in horizon; compute it again"),
        (7, 4, {"horizon": 6, "physics": {"mass": 1.0}, "a": 1, "b": 2, "c": 3}, r"differs in (\S+, ){2}\S+; compute"),
    ],
)
def test_other_episodes_are_refused(file, seed, episodes, task, message):
    with pytest.raises(SafeInspectError, match=message):
        read_reference(file, seed, episodes, task)


def test_a_file_without_a_task_is_of_every_task(tmp_path):
    path = tmp_path / "plans.json"
    path.write_text('{"seed": 0, "delta_v": [2]}')
    assert read_reference(path, 0, 1, TASK).tolist() == [2.0]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"seed": 1}', '{"delta_v": []}', '{"seed": "x", "delta_v": []}',
                                  '{"seed": 1, "delta_v": ["x"]}', '{"seed": 1, "delta_v": 3}'])  # fmt: skip
def test_a_damaged_file_is_one_message(tmp_path, text):
    path = tmp_path / "plans.json"
    path.write_text(text)
    with pytest.raises(SafeInspectError, match=r"plans\.json: the reference is damaged"):
        read_reference(path, 1, 1)


def test_a_missing_file_is_one_message(tmp_path):
    with pytest.raises(SafeInspectError, match="the reference cannot be read"):
        read_reference(tmp_path / "none.json", 1, 1)
