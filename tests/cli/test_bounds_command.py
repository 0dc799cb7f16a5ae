"""`safe-inspect bounds` as a user types it: what disturbs the motion, and what the filter needs."""

from __future__ import annotations

import pytest

from safe_inspect.cli.main import main

ORBITS = "configs/translational-inspection/experiment-burn-and-coast-orbits.yml"
TEAM = "configs/multiagent-translational-inspection/experiment-burn-and-coast-orbits.yml"
SIMULATOR = "config.config.env_config.simulator.config"
_OWN = "RTAGlueCWHInspection1v1.config"


def table(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, list[str], dict[str, list[str]], str]:
    """Return the exit code, the lines, the cells of each row by its name, and what was printed to standard error."""
    code = main(["bounds", *words])
    said = capsys.readouterr()
    lines = said.out.splitlines()
    rows = {line.split()[0]: line.split()[1:] for line in lines if len(line.split()) == 6}
    return code, lines, rows, said.err


def test_the_parts_add_up_to_what_the_filter_tolerates(capsys: pytest.CaptureFixture[str]) -> None:
    code, lines, rows, _ = table(capsys, ORBITS)
    assert code == 0
    assert lines[0] == "blue0_ctrl, RTAGlueCWHInspection1v1: in a step of 10 s, within 800 m and 1.73 m/s, 12 kg"
    assert list(rows) == ["BoundedDisturbance", "ThrusterModel", "SolarPressure", "RelativeOrbit", "total", "filter"]
    assert lines[-1] == "the filter tolerates this"
    assert rows["BoundedDisturbance"] == ["0", "0.05", "0.001", "0", "0"]
    for column in range(5):
        parts = [float(cells[column]) for name, cells in rows.items() if name not in ("total", "filter")]
        assert float(rows["total"][column]) == pytest.approx(sum(parts), rel=0.01)
        assert float(rows["filter"][column]) >= float(rows["total"][column])


@pytest.mark.parametrize("bounds", ["null", "{velocity: 1e-3}"])
def test_a_filter_that_needs_more_is_told_what_and_then_accepted(
    capsys: pytest.CaptureFixture[str], bounds: str
) -> None:
    code, lines, _, _ = table(capsys, ORBITS, f"{_OWN}.disturbance={bounds}")
    assert code == 1
    needed = lines[-1].removeprefix("the filter needs `disturbance: ").removesuffix("`")
    assert table(capsys, ORBITS, f"{_OWN}.disturbance={needed}")[0] == 0


def test_the_filter_of_the_team_counts_if_it_is_enabled(capsys: pytest.CaptureFixture[str]) -> None:
    code, lines, rows, _ = table(capsys, TEAM)
    assert (code, lines[0].split(",")[0], len(rows)) == (0, "the team", 6)
    code, lines, _, _ = table(capsys, TEAM, "config.config.env_config.rta.config.disturbance=null")
    assert (code, lines[0].split(",")[0]) == (1, "the team")
    code, lines, _, _ = table(capsys, TEAM, "config.config.env_config.rta.config.enabled=False")
    heads = [line.split(",")[0] for line in lines if "in a step of" in line]
    assert heads == ["blue0_ctrl", "the team"]
    assert code == 1


def test_a_mistake_that_is_not_of_a_filter_is_printed_alone(capsys: pytest.CaptureFixture[str]) -> None:
    twice = f"{SIMULATOR}.disturbance=[{{functor: ThrusterModel}}, {{functor: ThrusterModel}}]"
    code, _, _, err = table(capsys, ORBITS, twice)
    assert (code, err.count("there are 2 components ThrusterModel")) == (2, 1)
    assert "enabled" not in err


def test_a_part_without_a_bound_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    failing = f"{SIMULATOR}.disturbance={{functor: ThrusterModel, config: {{failure_probability: 0.1}}}}"
    code, lines, _, _ = table(capsys, ORBITS, failing)
    assert code == 1
    assert any(line.split() == ["ThrusterModel", *["no", "bound"] * 5] for line in lines)
    assert lines[-1] == "ThrusterModel: no bound, so the filter can give no guarantee"


def test_the_constraint_that_an_orbit_excludes_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    shipped = "configs/translational-inspection/experiment.yml"
    orbit = f"{SIMULATOR}.dynamics={{functor: RelativeOrbit, config: {{eccentricity: 0.01}}}}"
    for enabled in (True, False):
        code, lines, _, _ = table(
            capsys, shipped, orbit, f"{_OWN}.enabled={enabled}", f"{_OWN}.disturbance={{velocity: 5e-3}}"
        )
        assert code == 1
        assert lines[-2] == "the filter tolerates this"
        assert lines[-1].endswith("needs a circular orbit and a sun in its plane: `constraints: {sun: !remove }`")


def test_other_mistakes_are_reported_as_ever(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, _, said = table(capsys, ORBITS, f"{SIMULATOR}.dynamics.config.eccentricity=0.2")
    assert code == 2
    assert "the perigee is inside of the Earth" in said
    code, lines, _, _ = table(capsys, "configs/translational-inspection/experiment.yml")
    assert (code, lines[-1]) == (0, "the filter tolerates this")


def test_what_else_keeps_a_filter_from_being_enabled_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    shipped = "configs/translational-inspection/experiment.yml"
    code, lines, _, _ = table(capsys, shipped, f"{_OWN}.enabled=True", "illumination_params.mean_motion=0.002")
    assert code == 1
    assert lines[-2] == "the filter tolerates this"
    assert lines[-1].startswith("it is also refused: ")
    assert "the constraint `sun` needs a sun with one rotation per orbit" in lines[-1]
