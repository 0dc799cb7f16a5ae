"""The audit: states that graze the limits keep a plan under any setting, by a checker that knows nothing of filters."""

from __future__ import annotations

import itertools

import numpy as np

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.rta.audit import Audit, audit, grazing_states, settings
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, RelativeState
from safe_inspect.simulators.view import FilterResult


def test_no_state_that_grazes_a_limit_loses_its_plan():
    """These settings are among those in which plans were lost, when a closed motion was certified at one phase only."""
    told: list[int] = []
    found = audit(9, rows=24, steps=20, progress=lambda done: told.append(done.settings))
    assert told == list(range(1, 10))
    assert found.starts > 300
    assert found.steps == 20 * found.starts
    assert (found.infeasible, found.violations) == (0, 0)
    assert all(0.0 < least < 0.1 for name, least in found.least.items() if name != "r_max")


def test_the_initial_states_lie_on_the_edge_of_what_is_accepted():
    run = BackupFilter()
    states = grazing_states(run, np.random.default_rng(0), 32)
    assert len(states) > 20
    assert run.recoverable(states).all()
    least = run.phi(states).min(axis=0)
    assert least.min() > 0.0
    generator = np.random.default_rng(1)
    refused = np.zeros(len(states), bool)
    for _ in range(12):
        near = RelativeState(
            states.position + 1e-6 * generator.normal(size=states.position.shape),
            states.velocity + 1e-9 * generator.normal(size=states.velocity.shape),
            states.sun_angle,
        )
        refused |= ~run.recoverable(near)
    assert refused.mean() > 0.8


def test_the_checker_finds_what_an_unfiltered_flight_breaks(monkeypatch):
    def unfiltered(self, state, desired, memory):
        none = np.zeros(len(state), bool)
        return FilterResult(desired, none, none, none, none.astype(int), self.phi(state), self.names), memory

    monkeypatch.setattr(BackupFilter, "track", unfiltered)
    found = audit(0, rows=24, steps=20, first=BackupFilter())
    assert found.violations > 1000
    assert all(least < 0.0 for name, least in found.least.items() if name != "r_max"), found.least
    assert "violations" in str(found)


def test_settings_differ_and_choose_constraints():
    drawn = list(itertools.islice(settings(3), 30))
    assert len({values["m"] for values, _ in drawn}) == 30
    assert 5 < sum(names == NAMES for _, names in drawn) < 25
    assert Audit().least.keys() == set(NAMES)


def test_the_command_audits_the_filter_of_a_file(capsys):
    shipped = str(configs_root() / "translational-inspection" / "experiment.yml")
    assert main(["safety", shipped, "--audit", "1", "--seed", "4"]) == 0
    out, err = capsys.readouterr()
    assert "2 of 2 settings" in err
    assert "infeasible             0" in out
    assert "violations             0" in out
    docking = str(configs_root() / "docking" / "experiment.yml")
    assert main(["safety", docking, "--audit", "1"]) == 2
    assert "the audit supports only RTAGlueCWHInspection1v1" in capsys.readouterr().err
