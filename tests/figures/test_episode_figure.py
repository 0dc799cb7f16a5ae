from __future__ import annotations

import builtins
import dataclasses
import sys

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation.rollouts import record_episode
from safe_inspect.figures import curves_figure, save, trajectory_figure
from safe_inspect.figures.drawing import reach_of, speed_limit_of
from safe_inspect.figures.scene import ring_radii
from safe_inspect.policies import ZeroThrust

PNG = b"\x89PNG"
HEADER = "iteration,steps,return_mean,success_rate,inspected_fraction,delta_v"


def texts(figure):
    return [text.get_text() for text in figure.texts]


def test_a_trajectory_renders_and_states_what_was_inspected(flown, tmp_path):
    figure = trajectory_figure(flown)
    seen = int(np.isfinite(flown.inspected_at).sum())
    assert 0 < seen < 100
    assert any(text.startswith(f"{seen} of 100 points inspected") and "(lost)" in text for text in texts(figure))
    assert "crosses: not inspected" in texts(figure)
    save(figure, tmp_path / "new" / "picture.png")
    assert (tmp_path / "new" / "picture.png").read_bytes().startswith(PNG)


def test_the_axes_of_a_trajectory_have_one_scale(flown):
    axes = trajectory_figure(flown).axes[0]
    spans = np.ptp([axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d()], axis=1)
    np.testing.assert_allclose(spans / axes.get_box_aspect(), spans[0] / axes.get_box_aspect()[0])
    low, high = np.array([axes.get_xlim3d(), axes.get_ylim3d(), axes.get_zlim3d()]).T
    assert (flown.position >= low).all()
    assert (flown.position <= high).all()


def test_a_whole_inspection_has_no_crosses(flown):
    whole = dataclasses.replace(flown, inspected_at=np.zeros(100), status=DoneStatus.WIN)
    assert "crosses: not inspected" not in texts(trajectory_figure(whole))


def test_a_drift_renders(spec, tmp_path):
    drift = record_episode(spec, ZeroThrust(), seed=3).until(600.0)
    figure = trajectory_figure(drift)
    save(figure, tmp_path / "drift.png")
    assert not any(line.get_label() == "burn" for line in figure.axes[0].get_lines())


def panels(figure):
    """Return the axes over time by the beginning of their label."""
    return {axes.get_ylabel().split()[0]: axes for axes in figure.axes if axes.get_ylabel()}


def test_the_points_are_coloured_by_the_time_of_their_inspection(flown):
    figure = trajectory_figure(flown)
    when, front = flown.inspected_at / 60.0, 0
    for axes in figure.axes[1:3]:  # the chief from two sides
        dots, missed = axes.collections
        front += len(missed.get_offsets()) + len(dots.get_offsets())
        assert set(np.round(dots.get_array(), 9)) <= set(np.round(when[np.isfinite(when)], 9))
        assert dots.norm.vmin == 0.0
        assert dots.norm.vmax == pytest.approx(flown.time[-1] / 60.0)
    assert front == len(flown.points)


def test_the_colours_of_a_long_episode_use_one_unit_of_time(flown):
    long = dataclasses.replace(flown, time=flown.time * 300.0, inspected_at=flown.inspected_at * 300.0)
    assert long.time[-1] > 86_400.0
    figure = trajectory_figure(long)
    colours = {
        round(float(c), 9)
        for axes in figure.axes[1:3]  # the chief from both sides
        for dots in axes.collections
        if dots.get_array() is not None
        for c in dots.get_array()
    }
    hours = long.inspected_at[np.isfinite(long.inspected_at)] / 3600.0
    assert colours
    assert colours <= set(np.round(hours, 9))


def test_the_speed_is_drawn_against_its_published_limit(flown):
    lines = panels(trajectory_figure(flown))["speed"].get_lines()
    np.testing.assert_allclose(lines[0].get_ydata(), np.linalg.norm(flown.velocity[:, 0], axis=-1))
    distance = np.linalg.norm(flown.position[:, 0], axis=-1)
    np.testing.assert_allclose(lines[1].get_ydata(), 0.2 + 2.0 * flown.mean_motion * (distance - 10.0))
    np.testing.assert_allclose(lines[1].get_ydata(), speed_limit_of(flown)[:, 0])


def test_the_thrust_of_each_axis_is_drawn(flown):
    shown = panels(trajectory_figure(flown))
    for axis, name in enumerate("xyz"):
        drawn = max(shown[name].get_lines(), key=lambda line: len(line.get_xdata()))
        np.testing.assert_allclose(drawn.get_ydata()[:-1], flown.control[:, 0, axis])


def test_the_burns_stand_where_they_were_and_point_along_the_thrust(spec):
    from safe_inspect.policies import NaturalMotionInspector

    flown = record_episode(spec, NaturalMotionInspector(), seed=1)
    axes = trajectory_figure(flown).axes[0]
    strokes = next(line for line in axes.get_lines() if line.get_color() == "#222222" and len(line.get_xdata()) > 2)
    ends = np.stack(strokes.get_data_3d(), axis=-1).reshape(-1, 3, 3)
    burning = np.flatnonzero(np.abs(flown.control[:, 0]).sum(axis=-1))
    np.testing.assert_allclose(ends[:, 0], flown.position[burning, 0])
    along, thrust = ends[:, 1] - ends[:, 0], flown.control[burning, 0]
    cosine = (along * thrust).sum(axis=1) / np.linalg.norm(along, axis=1) / np.linalg.norm(thrust, axis=1)
    np.testing.assert_allclose(cosine, 1.0)


def test_several_deputies_have_a_colour_and_a_legend_each(flown_team, tmp_path):
    flown = flown_team
    figure = trajectory_figure(flown)
    save(figure, tmp_path / "three.svg")
    legends = [[text.get_text() for text in legend.get_texts()] for legend in figure.legends]
    assert ["deputy blue0", "deputy blue1", "deputy blue2"] in legends
    assert ["start", "end", "burn", "sun at the start", "at the end"] in legends
    counts = np.bincount(flown.inspector + 1, minlength=4)[1:]
    assert [f"blue{index}: {count}" for index, count in enumerate(counts)] in legends
    ways = {line.get_label(): line.get_color() for line in figure.axes[0].get_lines()}
    assert len({ways[f"deputy {name}"] for name in flown.deputies}) == 3
    np.testing.assert_allclose(sum(flown.coverage_of(index) for index in range(3)), flown.coverage)


def test_a_deputy_that_is_lost_does_not_dwarf_the_others(flown_team):
    position = flown_team.position.copy()
    position[-5:, 1] *= 1000.0
    lost = dataclasses.replace(flown_team, position=position)
    assert reach_of(lost) <= 1000.0
    axes = trajectory_figure(lost).axes[0]
    assert np.abs(axes.get_xlim3d()).max() < 2000.0


def test_rings_are_round_and_few():
    for reach in (7.0, 30.0, 99.0, 130.0, 480.0, 830.0, 4e4):
        rings = ring_radii(reach)
        assert 1 <= len(rings) <= 4
        assert reach / 2.01 <= rings[-1] <= reach
        np.testing.assert_allclose(np.diff([0.0, *rings]), rings[0])


def test_figures_leave_no_state_behind(flown, tmp_path):
    from matplotlib import pyplot, rcParams

    before = dict(rcParams)
    save(trajectory_figure(flown), tmp_path / "a.png")
    assert pyplot.get_fignums() == []
    assert dict(rcParams) == before


def test_a_figure_that_cannot_be_written_is_one_message(flown, tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "a.png", tmp_path / "a.nonsense"):
        with pytest.raises(OutputError, match="the file cannot be written"):
            save(trajectory_figure(flown), path)


def test_a_learning_curve_renders_what_is_known(tmp_path):
    path = tmp_path / "progress.csv"
    rows = ["1,4000,nan,nan,nan,nan", "2,8000,0.5,0.0,0.4,20.5", "3,12000,0.7,0.1,,18"]
    path.write_text(
        "\n".join([HEADER + ",evaluation_return_mean", *(f"{row},nan" for row in rows[:2]), rows[2] + ",0.9"])
    )
    figure = curves_figure({"run": [path]})
    evaluated, curve = figure.axes[0].get_lines()
    np.testing.assert_allclose(curve.get_xdata()[[0, -1]], [8.0, 12.0])  # thousands of steps
    np.testing.assert_allclose(curve.get_ydata()[[0, -1]], [0.5, 0.7])
    np.testing.assert_allclose(evaluated.get_ydata(), [np.nan, np.nan, 0.9])
    np.testing.assert_allclose(figure.axes[2].get_lines()[0].get_ydata(), [40.0])
    assert figure.axes[3].get_xlabel() == "environment steps [thousands]"
    save(figure, tmp_path / "curve.png")
    assert (tmp_path / "curve.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot read"),
        (HEADER, "no rows yet"),
        (HEADER.replace("success_rate", "success"), "no column `success_rate`; did you mean `success`"),
        ("", "it has no column `steps`$"),
        (f"{HEADER}\n1,4,1,1,1,1\n2,8,1,one,1,1", "progress.csv:3: the file is damaged: `success_rate` is 'one', not"),
        (f"{HEADER}\n2,8,1,1,1,1\n1,4,1,1,1,1", "progress.csv:3: the file is damaged: `steps` must not decrease"),
        (f"{HEADER}\n1,,1,1,1,1\n2,8,1,1,1,1", "progress.csv:2: the file is damaged: `steps` must not decrease"),
    ],
)  # fmt: skip
def test_a_wrong_progress_file_is_one_message(tmp_path, text, message):
    path = tmp_path / "progress.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(SafeInspectError, match=message):
        curves_figure({"run": [path]})


def test_without_matplotlib_the_message_says_what_to_install(flown, monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    real = builtins.__import__

    def no_matplotlib(name, *args, **kwargs):
        if name.split(".")[0] == "matplotlib":
            raise ModuleNotFoundError(f"No module named {name!r}", name="matplotlib")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_matplotlib)
    with pytest.raises(SafeInspectError, match=r"pip install 'safe_inspect\[plot\]'"):
        trajectory_figure(flown)
