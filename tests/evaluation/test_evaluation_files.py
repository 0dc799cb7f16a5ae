"""What an evaluation takes from raw episodes, and what its files give back."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.evaluation.episodes import GAP, AgentEpisodes, Episodes
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.evaluation.results.files import (
    TRAJECTORIES,
    read_evaluation,
    read_trajectories,
    save_packed,
    write_evaluation,
)
from safe_inspect.evaluation.results.results import Block, Evaluation, EvaluationError
from safe_inspect.evaluation.results.tables import compare
from safe_inspect.metrics.statistics import paired_difference, wilson

COUNT = 6
RECORD = {"seed": 3, "episodes": COUNT, "task": {"horizon": 10}}


def agent(seed: int) -> AgentEpisodes:
    generator = np.random.default_rng(seed)
    return AgentEpisodes(
        returns=generator.normal(size=COUNT),
        terms={"Seen": generator.normal(size=COUNT), f"Own{seed}": generator.normal(size=COUNT)},
        length=generator.integers(5, 90, COUNT),
        status=generator.integers(1, 4, COUNT).astype(np.int8),
        delta_v=generator.uniform(1.0, 9.0, COUNT),
        info={"own_count": generator.integers(0, 50, COUNT)},
        metrics={"closest": generator.uniform(10.0, 90.0, COUNT)},
    )


def episodes() -> Episodes:
    generator = np.random.default_rng(9)
    return Episodes.of(
        {"red": agent(1), "blue": agent(2)},
        seed=3,
        length=generator.integers(5, 90, COUNT),
        status=generator.integers(1, 4, COUNT).astype(np.int8),
        info={"fraction": generator.uniform(size=COUNT)},
        closest=generator.uniform(10.0, 90.0, COUNT),
        metrics={"spin": generator.uniform(size=COUNT)},
        units={"spin": "rad/s", "closest": "m"},
        labels={"fraction": ("inspected", "%"), "own_count": ("own points", "points")},
        initial_states={
            "position": generator.normal(size=(COUNT, 2, 3)),
            "velocity": generator.normal(size=(COUNT, 2, 3)),
            "sun_angle": generator.normal(size=COUNT),
        },
    )


def test_the_figures_are_those_of_the_raw_episodes():
    raw = episodes()
    found = Evaluation.of("mine", raw, RECORD, reference=np.full(COUNT, 0.5))
    red, blue = raw.agents.values()
    team = {
        "return": red.returns + blue.returns,
        "delta-v": (red.delta_v + blue.delta_v) / 2.0,
        "length": raw.length,
        "closest deputies": raw.closest,
        "inspected": raw.info["fraction"],
        GAP: (red.delta_v + blue.delta_v) / 2.0 - 0.5,
        "reward/Seen": red.terms["Seen"] + blue.terms["Seen"],
        "reward/Own1": red.terms["Own1"],
        "reward/Own2": blue.terms["Own2"],
        "spin": raw.metrics["spin"],
    }
    team["delta-v per deputy"] = team.pop("delta-v")
    assert found.team.figures.keys() == team.keys()
    for name, values in team.items():
        np.testing.assert_allclose(found.team.figures[name], values, rtol=1e-15, err_msg=name)
    words = {1: "win", 2: "lose", 3: "draw"}
    assert found.team.status.tolist() == [DoneStatus(code).name.lower() for code in raw.status]
    for name, own in raw.agents.items():
        expected = {
            "return": own.returns, "delta-v": own.delta_v, "length": own.length, "own points": own.info["own_count"],
            "closest": own.metrics["closest"], **{f"reward/{term}": values for term, values in own.terms.items()},
        }  # fmt: skip
        assert found.agents[name].figures.keys() == expected.keys()
        for figure, values in expected.items():
            np.testing.assert_array_equal(found.agents[name].figures[figure], values, err_msg=figure)
        assert found.agents[name].status.tolist() == [words.get(int(code), "") for code in own.status]
        assert found.agents[name].success_rate == np.mean(own.status == 1)
    assert (found.units["own points"], found.units["inspected"], found.units["spin"]) == ("points", "%", "rad/s")
    assert found.initial_states is raw.initial_states


def test_an_evaluation_comes_back_from_its_folder(tmp_path):
    written = Evaluation.of("mine", episodes(), RECORD)
    write_evaluation(written, tmp_path)
    read = read_evaluation(tmp_path)
    assert (read.label, read.units) == ("mine", written.units)
    for one, other in zip(
        (written.team, *written.agents.values()), (read.team, *read.agents.values()), strict=True
    ):  # fmt: skip
        assert one.status.tolist() == other.status.tolist()
        assert one.figures.keys() == other.figures.keys()
        for name, values in one.figures.items():
            np.testing.assert_array_equal(other.figures[name], values, err_msg=name)
    assert list(read.agents) == ["red", "blue"]
    assert read.initial_states.keys() == written.initial_states.keys()
    for name, values in written.initial_states.items():
        np.testing.assert_array_equal(read.initial_states[name], values, err_msg=name)


def flight(seed: int, steps: int, **more) -> Trajectory:
    generator = np.random.default_rng(seed)
    status = DoneStatus.WIN if seed % 2 else DoneStatus.LOSE
    return Trajectory(
        time=10.0 * np.arange(steps + 1),
        position=generator.normal(size=(steps + 1, 2, 3)),
        velocity=generator.normal(size=(steps + 1, 2, 3)),
        control=generator.normal(size=(steps, 2, 6)),
        delta_v=generator.uniform(size=(steps + 1, 2)),
        status=status,
        slot=seed,
        deputies=("red", "blue"),
        arrays={"sun_angle": generator.normal(size=steps + 1), "orientation": generator.normal(size=(steps + 1, 2, 4))},
        points=generator.normal(size=(5, 3)),
        inspected_at=np.array([np.inf, 0.0, 10.0, np.inf, 20.0]),
        inspector=np.array([-1, 0, 1, -1, 0]),
        mean_motion=0.001,
        in_body_axes=True,
        **more,
    )


def test_recorded_episodes_come_back_from_their_file(tmp_path):
    written = [flight(4, 7, camera=((0.0, 0.6, 0.8), 0.3)), flight(7, 3, docking_radius=2.5)]
    write_evaluation(dataclasses.replace(Evaluation.of("mine", episodes(), RECORD), trajectories=written), tmp_path)
    for one, other in zip(written, read_trajectories(tmp_path), strict=True):
        for field in dataclasses.fields(Trajectory):
            mine, theirs = getattr(one, field.name), getattr(other, field.name)
            if field.name == "arrays":
                assert mine.keys() == theirs.keys()
                for name, values in mine.items():
                    np.testing.assert_array_equal(theirs[name], values, err_msg=name)
            elif isinstance(mine, np.ndarray):
                np.testing.assert_array_equal(theirs, mine, err_msg=field.name)
            else:
                assert mine == theirs, field.name


def test_arrays_are_named_by_their_paths(tmp_path):
    written = dataclasses.replace(Evaluation.of("mine", episodes(), RECORD), trajectories=[flight(4, 7)])
    write_evaluation(written, tmp_path)
    with np.load(tmp_path / "episodes.npz") as arrays:
        np.testing.assert_array_equal(arrays["team/figures/length"], written.team.figures["length"])
        np.testing.assert_array_equal(arrays["agents/red/figures/return"], written.agents["red"].figures["return"])
        np.testing.assert_array_equal(arrays["agents/red/status"], written.agents["red"].status)
        np.testing.assert_array_equal(arrays["initial_states/position"], written.initial_states["position"])
    with np.load(tmp_path / "trajectories.npz") as arrays:
        np.testing.assert_array_equal(arrays["0/position"], written.trajectories[0].position)


def test_recorded_episodes_that_another_evaluation_wrote_are_refused(tmp_path):
    whole = Evaluation.of("mine", episodes(), RECORD)
    write_evaluation(dataclasses.replace(whole, trajectories=[flight(4, 7)]), tmp_path)
    assert len(read_trajectories(tmp_path)) == 1
    save_packed(tmp_path / TRAJECTORIES, (flight(5, 7),))
    with pytest.raises(EvaluationError, match="was damaged or changed after it was written; evaluate again"):
        read_trajectories(tmp_path)


def test_damaged_recorded_episodes_are_one_message(tmp_path):
    file = tmp_path / TRAJECTORIES
    save_packed(file, (flight(4, 7, camera=((0.0, 0.6, 0.8), 0.3)),))
    assert len(read_trajectories(file)) == 1
    with np.load(file) as arrays:
        whole = dict(arrays)
    for damaged in (
        {name: array for name, array in whole.items() if name != "0/position"},
        {name: array for name, array in whole.items() if name != "tree"},
        {**whole, "tree": np.array('{"tuple": 1}')},
        {**whole, "tree": np.array('{"class": "Other", "fields": {}}')},
        {**whole, "tree": np.array('{"class": "Trajectory", "fields": 1}')},
    ):
        np.savez(file, **damaged)
        with pytest.raises(EvaluationError, match="the file cannot be read"):
            read_trajectories(tmp_path)
    for content in (b"", b"PK damaged", file.read_bytes()[:500]):
        file.write_bytes(content)
        with pytest.raises(EvaluationError, match="the file cannot be read"):
            read_trajectories(tmp_path)


def evaluation(label: str, figures: dict[str, float], **record) -> Evaluation:
    status = np.full(COUNT, "win", dtype=object)
    arrays = {name: value + np.arange(COUNT) for name, value in figures.items()}
    return Evaluation(label, Block(status, arrays), {}, {}, {}, {**RECORD, **record})


def test_a_figure_that_one_evaluation_lacks_is_shown_as_missing():
    first, other = evaluation("first", {"delta-v": 3.0}), evaluation("other", {"delta-v": 1.0, "points": 7.0})
    found = compare([first, other])
    assert found.differences["points"] == {}
    rows = {line.split()[0]: line.split()[1:3] for line in str(found).splitlines() if line.startswith("  ")}
    (line,) = (line.split() for line in str(found).splitlines() if line.split()[:1] == ["points"])
    assert line == ["points", "-", "9.5000", "-"]
    assert rows["delta-v"][0] == "-2.0000"


def test_what_differs_is_named_with_whose_it_is():
    with pytest.raises(EvaluationError, match="first and other cannot be compared: the seed is 3 in one and 5 in the"):
        compare([evaluation("first", {}), evaluation("other", {}, seed=5)])


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (evaluation("first", {}), "two evaluations have the same label; give each a different label"),
        (
            dataclasses.replace(evaluation("other", {}), initial_states={"position": np.zeros(COUNT)}),
            "first and other cannot be compared: their deputies differ; evaluate both with the same --seed, --episodes",
        ),
    ],
)
def test_what_cannot_be_compared_is_refused(other, message):
    with pytest.raises(EvaluationError, match=message):
        compare([evaluation("first", {}), other])


def test_one_evaluation_is_not_compared():
    with pytest.raises(EvaluationError, match="a comparison needs at least two evaluations, got 1; give another"):
        compare([evaluation("first", {})])


def test_episodes_are_paired_one_for_one():
    with pytest.raises(ValueError, match=r"paired values must have the same shape, not \(3,\) and \(4,\)"):
        paired_difference(np.zeros(3), np.zeros(4))


def test_without_trials_nothing_is_known_of_a_rate():
    found = wilson(0, 0)
    assert np.isnan((found.low, found.high)).all()


def test_a_folder_without_an_evaluation_says_what_to_give(tmp_path):
    with pytest.raises(EvaluationError, match="not an evaluation; give a folder that"):
        read_evaluation(tmp_path)
    with pytest.raises(EvaluationError, match="not an evaluation; give a folder that"):
        read_evaluation(tmp_path / "missing")
