from __future__ import annotations

import builtins
import dataclasses
import sys

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.errors import OutputError, SafeInspectError
from safe_inspect.evaluation import rollout
from safe_inspect.evaluation.plots import learning_curve_figure, save, trajectory_figure
from safe_inspect.policies import RandomThrust, ZeroThrust

PNG = b"\x89PNG"
HEADER = "iteration,steps,return_mean,success_rate,inspected_fraction,delta_v"


@pytest.fixture(scope="module")
def flown(spec):
    return rollout(spec, RandomThrust(), episodes=1, seed=3, record=1).trajectories[0]


def texts(figure):
    return [text.get_text() for text in figure.texts]


def test_a_trajectory_renders_and_tells_what_was_inspected(flown, tmp_path):
    figure = trajectory_figure(flown)
    seen = int(np.isfinite(flown.inspected_at).sum())
    assert 0 < seen < 100
    assert any(text.startswith(f"{seen} of 100 points inspected") and "lose" in text for text in texts(figure))
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
    drift = rollout(spec, ZeroThrust(), episodes=1, seed=3, record=1).trajectories[0]
    save(trajectory_figure(drift), tmp_path / "drift.png")


def test_several_deputies_have_a_colour_and_a_legend_each(team, tmp_path):
    flown = rollout(team, RandomThrust(), episodes=1, seed=3, record=1).trajectories[0]
    figure = trajectory_figure(flown)
    save(figure, tmp_path / "three.svg")
    legends = [[text.get_text() for text in legend.get_texts()] for legend in figure.legends]
    assert ["deputy blue0", "deputy blue1", "deputy blue2"] in legends
    assert ["start", "end", "sun at the start", "sun at the end"] in legends
    counts = np.bincount(flown.inspector + 1, minlength=4)[1:]
    assert [f"blue{index}: {count}" for index, count in enumerate(counts)] in legends
    ways = {line.get_label(): line.get_color() for line in figure.axes[0].get_lines()}
    assert len({ways[f"deputy {name}"] for name in flown.deputies}) == 3
    np.testing.assert_allclose(sum(flown.coverage_of(index) for index in range(3)), flown.coverage)


def test_figures_leave_no_state_behind(flown, tmp_path):
    from matplotlib import pyplot, rcParams

    before = dict(rcParams)
    save(trajectory_figure(flown), tmp_path / "a.png")
    assert pyplot.get_fignums() == []
    assert dict(rcParams) == before


def test_a_figure_that_cannot_be_written_is_one_message(flown, tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "a.png", tmp_path / "a.nonsense"):
        with pytest.raises(OutputError, match="cannot write the figure"):
            save(trajectory_figure(flown), path)


def test_a_learning_curve_renders_what_is_known(tmp_path):
    path = tmp_path / "progress.csv"
    rows = ["1,4000,nan,nan,nan,nan", "2,8000,0.5,0.0,0.4,20.5", "3,12000,0.7,0.1,,18"]
    path.write_text(
        "\n".join([HEADER + ",evaluation_return_mean", *(f"{row},nan" for row in rows[:2]), rows[2] + ",0.9"])
    )
    figure = learning_curve_figure(path)
    curve = figure.axes[0].get_lines()[0]
    np.testing.assert_allclose(curve.get_xdata(), [8.0, 12.0])  # thousands of steps
    np.testing.assert_allclose(curve.get_ydata(), [0.5, 0.7])
    np.testing.assert_allclose(figure.axes[0].get_lines()[1].get_ydata(), [0.9])
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
        ("", "no column `steps`"),
    ],
)  # fmt: skip
def test_a_wrong_progress_file_is_one_message(tmp_path, text, message):
    path = tmp_path / "progress.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(SafeInspectError, match=message):
        learning_curve_figure(path)


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
