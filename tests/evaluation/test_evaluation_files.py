"""What an evaluation takes from raw episodes, and what its files give back."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.evaluation.episodes import GAP, AgentEpisodes, Episodes, Trajectory
from safe_inspect.evaluation.results.files import (
    read_evaluation,
    read_trajectories,
    sha256,
    trajectory_table,
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
    states = found.initial_states
    for axis, letter in enumerate("xyz"):
        np.testing.assert_array_equal(states[f"blue/{letter}"], raw.initial_states["position"][:, 1, axis])
        np.testing.assert_array_equal(states[f"red/v{letter}"], raw.initial_states["velocity"][:, 0, axis])


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
    from pyarrow import parquet

    written = [flight(4, 7, camera=((0.0, 0.6, 0.8), 0.3)), flight(7, 3, docking_radius=2.5)]
    parquet.write_table(trajectory_table(written), tmp_path / "trajectories.parquet")
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


def test_recorded_episodes_that_another_evaluation_wrote_are_refused(tmp_path):
    from pyarrow import parquet

    file = tmp_path / "trajectories.parquet"
    parquet.write_table(trajectory_table([flight(4, 7)]), file)
    (tmp_path / "evaluation.json").write_text(json.dumps({"files": {file.name: sha256(file)}}))
    assert len(read_trajectories(tmp_path)) == 1
    parquet.write_table(trajectory_table([flight(5, 7)]), file)
    with pytest.raises(EvaluationError, match="was damaged or changed after it was written; evaluate again"):
        read_trajectories(tmp_path)


def test_damaged_recorded_episodes_are_one_message(tmp_path):
    from pyarrow import parquet

    table = trajectory_table([flight(4, 7, camera=((0.0, 0.6, 0.8), 0.3))])
    for damaged in (table.drop_columns(table.column_names[0]), table.replace_schema_metadata({})):
        parquet.write_table(damaged, tmp_path / "trajectories.parquet")
        with pytest.raises(EvaluationError, match="the recorded episodes are damaged"):
            read_trajectories(tmp_path)
    (tmp_path / "trajectories.parquet").write_bytes(b"PAR1 damaged")
    with pytest.raises(EvaluationError, match="the recorded episodes are damaged"):
        read_trajectories(tmp_path)


def test_the_columns_of_recorded_episodes_are_those_that_are_documented():
    one = flight(7, 4)
    steps = len(one.control)
    table = {name: column.to_numpy(zero_copy_only=False) for name, column in _columns_of(trajectory_table([one]))}
    axes = ("x", "y", "z")
    expected = {"episode", "step", "deputy", "time", "delta_v", "sun_angle", "inspected", "inspected_own"}
    expected |= {f"{start}{axis}" for start in ("", "v", "u", "m") for axis in axes}
    expected |= {f"orientation/{k}" for k in range(8)}  # four numbers of each of two deputies
    assert set(table) == expected
    rows = [(step, deputy) for step in range(steps + 1) for deputy in range(2)]
    assert list(table["step"]) == [step for step, _ in rows]
    assert list(table["deputy"]) == [one.deputies[deputy] for _, deputy in rows]
    for row, (step, deputy) in enumerate(rows):
        assert table["episode"][row] == 7
        assert table["time"][row] == one.time[step]
        assert table["sun_angle"][row] == one.sun_angle[step]
        assert table["delta_v"][row] == one.delta_v[step, deputy]
        for k, axis in enumerate(axes):
            assert table[axis][row] == one.position[step, deputy, k]
            assert table[f"v{axis}"][row] == one.velocity[step, deputy, k]
            held = one.control[step, deputy] if step < steps else np.full(6, np.nan)
            np.testing.assert_array_equal(table[f"u{axis}"][row], held[k])
            np.testing.assert_array_equal(table[f"m{axis}"][row], held[3 + k])
        for k in range(8):
            assert table[f"orientation/{k}"][row] == one.orientation[step].reshape(-1)[k]
        seen = one.inspected_at <= one.time[step]
        assert table["inspected"][row] == seen.sum()
        assert table["inspected_own"][row] == (seen & (one.inspector == deputy)).sum()


def _columns_of(table):
    return zip(table.column_names, table.columns, strict=True)


def evaluation(label: str, figures: dict[str, float], **record) -> Evaluation:
    status = np.full(COUNT, "win", dtype=object)
    arrays = {name: value + np.arange(COUNT) for name, value in figures.items()}
    return Evaluation(label, Block(status, arrays), {}, {}, {}, {**RECORD, **record})


def test_a_figure_that_one_evaluation_lacks_is_shown_as_missing():
    first, other = evaluation("first", {"delta-v": 3.0}), evaluation("other", {"delta-v": 1.0, "points": 7.0})
    found = compare([first, other])
    assert found.estimates["points"].keys() == {"other"}
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


def _edited(**columns):
    evaluation = Evaluation.of("mine", episodes(), RECORD)
    return {**evaluation.columns(), **columns}, evaluation.units


@pytest.mark.parametrize(
    "columns",
    [
        {"agent": np.array([], dtype=str), "episode": np.array([], dtype=np.int64)},
        {"episode": np.arange(2 * COUNT)},
        {"episode": np.arange(COUNT).repeat(2)[::-1]},
        {"agent": np.array(["red"] * COUNT + ["blue"] * COUNT)},
        {"agent": np.array(["red", "blue"] * (COUNT - 1) + ["blue", "red"])},
    ],
)
def test_rows_that_are_not_one_for_each_episode_and_agent_are_refused(columns):
    table, units = _edited(**columns)
    with pytest.raises(ValueError, match="expected one row for each episode and agent"):
        Evaluation.of_columns("mine", table, units, RECORD)


def test_a_folder_without_an_evaluation_says_what_to_give(tmp_path):
    with pytest.raises(EvaluationError, match="not an evaluation; give a folder that"):
        read_evaluation(tmp_path)
    with pytest.raises(EvaluationError, match="not an evaluation; give a folder that"):
        read_evaluation(tmp_path / "missing")
