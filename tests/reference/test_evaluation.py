"""Every array of an evaluation's files and tables, from its episodes flown again by the small simulation."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from safe_inspect.evaluation.results.files import read_evaluation
from safe_inspect.evaluation.results.tables import pooled_table

from .figures import blocks, bootstrap_bounds, iqm, mean, shows, shows_interval, wilson
from .flown import EPISODES, GAP, typed
from .one_deputy import DT

#: Figures of the whole episode alone, and of each agent alone.
OF_TEAM, OF_AGENT = (GAP, "inspected points", "inspected fraction", "time to 90 %"), ("inspected first",)
UNITS = {
    "inspected points": "points", "inspected first": "points", "delta-v": "m/s", "length": "steps", GAP: "m/s",
    "interventions": "steps", "smallest range": "m", "largest range": "m", "largest speed": "m/s",
    "time to 90 %": "s", "delta-v after last point": "m/s", "phi chief_collision": "m", "phi rel_vel": "m/s",
    "phi sun": "rad", "phi r_max": "m", "phi PSM": "m", "phi x_vel": "m/s", "phi y_vel": "m/s", "phi z_vel": "m/s",
}  # fmt: skip


@pytest.mark.parametrize("source", ["inspector", "random"])
def test_the_arrays_of_the_trajectories(flown, source):
    one = flown[source]
    for found, flight in zip(one.trajectories, one.flights, strict=True):
        np.testing.assert_array_equal(found["time"], DT * np.arange(flight.steps + 1))
        np.testing.assert_allclose(found["position"][:, 0], flight.position, rtol=0, atol=1e-7)
        np.testing.assert_allclose(found["velocity"][:, 0], flight.velocity, rtol=0, atol=1e-10)
        np.testing.assert_allclose(found["delta_v"][:, 0], flight.delta_v, rtol=1e-12)
        np.testing.assert_allclose(found["arrays/sun_angle"], flight.sun_angle, rtol=1e-12)
        seen = (found["inspected_at"] <= found["time"][:, None]).sum(axis=1)
        np.testing.assert_array_equal(seen, np.sum(flight.inspected, axis=1))
        np.testing.assert_array_equal(found["inspector"] >= 0, np.isfinite(found["inspected_at"]))


@pytest.mark.parametrize("source", ["inspector", "random"])
def test_the_arrays_of_the_episodes(flown, source):
    one, arrays = flown[source], dict(flown[source].episodes)
    arrays.pop("tree")
    for name in ("team/status", "agents/blue0_ctrl/status"):
        np.testing.assert_array_equal(arrays.pop(name), one.status)
    begun = {
        "position": [flight.position[:1] for flight in one.flights],
        "velocity": [flight.velocity[:1] for flight in one.flights],
        "sun_angle": [flight.sun_angle[0] for flight in one.flights],
    }
    for name, values in begun.items():
        np.testing.assert_array_equal(arrays.pop(f"initial_states/{name}"), np.array(values))
    for name, values in one.figures.items():
        for start, others in (("team", OF_AGENT), ("agents/blue0_ctrl", OF_TEAM)):
            if name not in others:
                found = arrays.pop(f"{start}/figures/{name}")
                np.testing.assert_allclose(found, values, rtol=1e-9, atol=1e-6, err_msg=name)
    assert not arrays, "every array is computed a second time"


def check_end(text: str, status: np.ndarray, *, digits: str = ".1f") -> None:
    """Check a line that says how episodes ended."""
    wins, count = int((status == "win").sum()), len(status)
    low, high = wilson(wins, count)
    expected = (
        f"success {100.0 * wins / count:{digits}} % (95 % interval {100 * low:{digits}} to {100 * high:{digits}} %"
    )
    assert expected in text
    for name in ("win", "lose", "draw"):
        found = int((status == name).sum())
        assert (f"{name} {found}" in text) if found else (f"{name} " not in text.partition("interval")[2])


def check_table(table: list[list[str]], strata: dict[str, list[np.ndarray]], units: dict[str, str]) -> None:
    """Check a printed table of figures; their values come in strata."""
    head, *rows = table
    assert head == ["mean", "std", "IQM", "95 % interval of the IQM", "min", "max", "unit"]
    assert {row[0] for row in rows} == set(strata)
    for name, average, spread, middle, interval, least, most, unit in rows:
        values = np.concatenate(strata[name])
        known = values[~np.isnan(values)]
        some = len(known) > 0
        assert shows(average, known.sum() / len(known) if some else math.nan), name
        spread_of = math.sqrt(np.square(known - known.mean()).sum() / (len(known) - 1)) if len(known) > 1 else math.nan
        assert shows(spread, spread_of), name
        assert shows(middle, iqm(known) if some else math.nan), name
        assert shows(least, known.min() if some else math.nan), name
        assert shows(most, known.max() if some else math.nan), name
        assert shows_interval(interval, strata[name], iqm), name
        share = "" if len(known) == len(values) else f" ({len(known)} of {len(values)})"
        assert unit == units.get(name, "-") + share


@pytest.mark.parametrize("source", ["inspector", "random"])
def test_the_printed_table(flown, source):
    one = flown[source]
    head = one.printed.splitlines()[0]
    assert head.startswith(f"{source}: {EPISODES} episodes, ")
    check_end(head, one.status)
    (table,) = blocks(one.printed)
    check_table(table, {name: [one.figures[name]] for name in one.figures if name not in OF_AGENT}, UNITS)


@pytest.mark.parametrize("source", ["inspector", "random"])
def test_the_numbers_of_the_record(flown, source):
    one = flown[source]
    wins = int((one.status == "win").sum())
    assert one.record["success"]["rate"] == wins / EPISODES
    assert one.record["success"]["interval"] == pytest.approx(wilson(wins, EPISODES), abs=1e-9)
    assert one.record["success"]["statuses"] == {
        name: int((one.status == name).sum()) for name in ("win", "lose", "draw") if (one.status == name).any()
    }
    assert set(one.record["figures"]) == set(one.figures) - set(OF_AGENT)
    for name, found in one.record["figures"].items():
        values = one.figures[name][~np.isnan(one.figures[name])]
        assert (found["count"], found["unit"]) == (len(values), UNITS.get(name, "-"))
        if not len(values):
            continue
        for key, value in {"mean": values.mean(), "iqm": iqm(values), "minimum": values.min()}.items():
            assert found[key] == pytest.approx(value, rel=1e-9, abs=1e-6), name
        assert found["maximum"] == pytest.approx(values.max(), rel=1e-9, abs=1e-6)
        assert found["standard_deviation"] == pytest.approx(np.std(values, ddof=1), rel=1e-6, abs=1e-6)
        for key, statistic in {"mean_interval": mean, "iqm_interval": iqm}.items():
            for end, (low, high) in zip(found[key], bootstrap_bounds([values], statistic), strict=True):
                assert low - 1e-6 <= end <= high + 1e-6, (name, key)


def test_the_table_of_sources_together(flown):
    """The bootstrap resamples the episodes of each source by themselves."""
    text = pooled_table([read_evaluation(one.folder) for one in flown.values()])
    (table,) = blocks(text)
    names = [name for name in flown["random"].figures if name not in OF_AGENT]
    check_table(table, {name: [one.figures[name] for one in flown.values()] for name in names}, UNITS)
    wins = [(one.status == "win").astype(float) for one in flown.values()]
    each = ", ".join(f"{100.0 * one.mean():.1f}" for one in wins)
    head = text.splitlines()[0]
    assert head.startswith(
        f"2 sources together: {2 * EPISODES} episodes, success {50.0 * sum(map(np.mean, wins)):.1f} % "
    )
    assert head.endswith(f"; each: {each})")
    interval = head.partition("interval ")[2].partition(" %")[0]
    for end, (low, high) in zip(interval.split(" to "), bootstrap_bounds(wins, mean), strict=True):
        assert 100.0 * low - 0.051 <= float(end) <= 100.0 * high + 0.051


def test_evaluations_side_by_side(flown, tmp_path):
    """The differences of `compare`, episode by episode, with their intervals."""
    first, other = flown["inspector"], flown["random"]
    text = typed("compare", first.folder, other.folder, "--json", tmp_path / "compared.json")
    sides, differences = blocks(text)[-2:]
    assert sides[0] == ["IQM", "inspector", "random", "unit"]
    names = [name for name in first.figures if name not in OF_AGENT]
    assert {row[0] for row in sides[1:]} == set(names)
    for name, one, two, unit in sides[1:]:
        for cell, values in ((one, first.figures[name]), (two, other.figures[name])):
            known = values[~np.isnan(values)]
            assert shows(cell, iqm(known) if len(known) else math.nan), name
        assert unit == UNITS.get(name, "-")
    for line, one in zip(text.splitlines()[1:3], (first, other), strict=True):
        check_end(line, one.status)
    apart = {name: other.figures[name] - first.figures[name] for name in names}
    apart["success"] = (other.status == "win").astype(float) - (first.status == "win")
    assert differences[0] == ["mean", "95 % interval", "IQM", "lower in", "higher in", "unit"]
    assert {row[0] for row in differences[1:]} == set(apart)
    content = json.loads((tmp_path / "compared.json").read_text())["differences"]
    for name, average, interval, middle, lower, higher, unit in differences[1:]:
        pairs = apart[name][~np.isnan(apart[name])]
        assert unit == UNITS.get(name, "-")
        told = content[name]["random"]
        assert told["count"] == len(pairs)
        if not len(pairs):
            assert (average, interval, middle, lower, higher) == ("-",) * 5
            continue
        assert shows(average.removesuffix(" *"), pairs.mean()), name
        assert shows(middle, iqm(pairs)), name
        assert shows_interval(interval, [apart[name]], mean), name
        assert (lower, higher) == (f"{100 * (pairs < 0).mean():.0f} %", f"{100 * (pairs > 0).mean():.0f} %")
        low, high = told["interval"]
        assert average.endswith(" *") == (low > 0.0 or high < 0.0)
        numbers = {"mean": pairs.mean(), "iqm": iqm(pairs), "smaller": (pairs < 0).mean(), "larger": (pairs > 0).mean()}
        for key, value in numbers.items():
            assert told[key] == pytest.approx(value, rel=1e-9, abs=1e-6), name
        for key, statistic in {"interval": mean, "iqm_interval": iqm}.items():
            for end, bounds in zip(told[key], bootstrap_bounds([pairs], statistic), strict=True):
                assert bounds[0] - 1e-6 <= end <= bounds[1] + 1e-6, (name, key)
