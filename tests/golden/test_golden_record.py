"""Every number of the recorded flights is as recorded: refactoring changes no bit.

A change that is meant to change numbers writes the record anew, and says why:

    python tests/golden/record.py
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from .flights import FLIGHTS, arithmetic, fly

RECORD = json.loads(Path(__file__).with_name("record.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
@pytest.mark.parametrize("flight", FLIGHTS)
def test_a_flight_gives_the_recorded_numbers(flight, compiled):
    hashes, sums = fly(flight, compiled=compiled)
    recorded = RECORD["flights"][flight]
    assert hashes.keys() == recorded["hashes"].keys()
    if arithmetic() == RECORD["arithmetic"]:
        assert hashes == recorded["hashes"]
    else:  # another processor: its sines differ in the last bit
        for name, values in sums.items():
            assert values == pytest.approx(recorded["sums"][name], rel=1e-6, abs=1e-6), name


def test_a_single_bit_is_noticed(monkeypatch):
    from safe_inspect.simulators import simulation

    advance_kernel = simulation.advance_kernel

    def disturbed_kernel(*args):
        advance = advance_kernel(*args)

        def disturbed(phi, gamma, position, *others):
            advance(phi, gamma, position, *others)
            position[0, 0, 0] += abs(position[0, 0, 0]) * 2.3e-16

        return disturbed

    monkeypatch.setattr(simulation, "advance_kernel", disturbed_kernel)
    hashes, _ = fly("one, continuous thrust", compiled=True)
    assert hashes["state/position"] != RECORD["flights"]["one, continuous thrust"]["hashes"]["state/position"]
