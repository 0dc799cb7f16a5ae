"""Every line and band of the figures of trainings, from the rows of progress.csv by NumPy alone."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from safe_inspect.figures import curves_figure

pytest.importorskip("matplotlib")

COLUMNS = ("return_mean", "success_rate", "inspected_fraction", "delta_v")
FACTORS = (1.0, 100.0, 100.0, 1.0)
RESAMPLES = 1000


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the values of four trainings, two of them shorter, and their files; the first row has no episode."""
    generator, folder, found = np.random.default_rng(4), tmp_path_factory.mktemp("runs"), []
    for index, last in enumerate((9, 7, 9, 6)):
        steps = 1000.0 * np.arange(1, last + 1) + 130.0 * index
        values = generator.uniform(0.1, 1.0, (len(COLUMNS), last))
        values[:, 0] = np.nan
        lines = [f"steps,{','.join(COLUMNS)}"]
        for row in np.column_stack((steps, values.T)):
            lines.append(",".join("" if np.isnan(cell) else repr(float(cell)) for cell in row))
        file = folder / f"{index}.csv"
        file.write_text("\n".join(lines))
        found.append((file, steps[1:], values[:, 1:]))
    return found


def centre(values, kind):
    """Return the mean, or that of the middle half, over the first axis."""
    cut = len(values) // 4 if kind == "iqm" else 0
    return np.sort(values, axis=0)[cut : len(values) - cut].mean(axis=0)


def interval_bounds(values, kind):
    """Return between which values the ends of the bootstrap's interval lie.

    All K^K resamples of K values are listed. The share of `RESAMPLES` draws below a value has the standard error
    sqrt(p (1 - p) / RESAMPLES), so an end lies between the quantiles at p - 5 s and p + 5 s but in one case of a
    million.
    """
    picks = np.array(list(itertools.product(range(len(values)), repeat=len(values))))
    every = np.array([centre(values[pick], kind) for pick in picks])
    width = 5.0 * np.sqrt(0.025 * 0.975 / RESAMPLES)
    return [
        (
            np.quantile(every, max(share - width, 0.0), method="lower"),
            np.quantile(every, min(share + width, 1.0), method="higher"),
        )
        for share in (0.025, 0.975)
    ]


@pytest.mark.parametrize("kind", ["mean", "iqm"])
def test_the_lines_and_bands_of_several_seeds(runs, kind):
    figure = curves_figure({"recipe": [file for file, _, _ in runs]}, kind, each=True)
    for panel, (axes, factor) in enumerate(zip(figure.axes, FACTORS, strict=True)):
        *seeds, whole, dotted = axes.get_lines()
        for line, (_, steps, values) in zip(seeds, runs, strict=True):  # thousands of steps
            known = np.isfinite(line.get_ydata())
            np.testing.assert_allclose(line.get_xdata()[known], steps / 1000.0)
            np.testing.assert_allclose(line.get_ydata()[known], factor * values[panel])
        grid = whole.get_xdata()
        assert (grid[0], grid[-1]) == pytest.approx((2.0, 9.26))
        known = np.array([(steps[0] <= 1000.0 * grid) & (1000.0 * grid <= steps[-1]) for _, steps, _ in runs])
        rows = np.array([np.interp(1000.0 * grid, steps, values[panel]) for _, steps, values in runs])
        expected = np.array([factor * centre(row[there], kind) for row, there in zip(rows.T, known.T, strict=True)])
        everyone = known.all(axis=0)
        np.testing.assert_allclose(whole.get_ydata()[everyone], expected[everyone], rtol=1e-9)
        assert np.isnan(whole.get_ydata()[~everyone]).all()
        np.testing.assert_allclose(dotted.get_ydata()[~everyone], expected[~everyone], rtol=1e-9)
        (band,) = axes.collections
        edges = {}
        for x, y in np.concatenate([path.vertices for path in band.get_paths()]):
            edges.setdefault(round(x, 9), []).append(y)
        for place in np.flatnonzero(known.sum(axis=0) >= 2)[::20]:
            values = factor * rows[known[:, place], place]
            (low, high), found = interval_bounds(values, kind), edges[round(grid[place], 9)]
            assert low[0] - 1e-9 <= min(found) <= low[1] + 1e-9
            assert high[0] - 1e-9 <= max(found) <= high[1] + 1e-9
