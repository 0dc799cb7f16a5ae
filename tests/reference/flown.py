"""Evaluations of a few episodes, and the same episodes flown again by the small simulation."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root

from .figures import figures_of
from .one_deputy import SEED, Flight, OneDeputy, Task

EPISODES, HORIZON = 8, 935
EXPERIMENT = str(configs_root() / "translational-inspection" / "experiment-seed.yml")
WORDS = (f"horizon={HORIZON}", "--episodes", str(EPISODES), "--seed", "11")
TASK = Task(**{**vars(SEED), "horizon": HORIZON})
#: Delta-v of a made-up open-loop optimum of each episode [m/s], unknown for one.
OPTIMUM = [0.1, 0.05, None, 0.2, 0.09, 0.11, 0.04, 0.07]
GAP = "gap to the open-loop optimum"


def starting(start: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays whose names have a prefix, by the rest of their names."""
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}


def typed(*words: str) -> str:
    """Return what a command prints."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([str(word) for word in words]) == 0
    return out.getvalue()


class Flown:
    """An evaluation: what was printed and written, and its episodes, flown again with the recorded thrusts."""

    def __init__(self, source: str, folder: Path) -> None:
        (folder / "ref.json").write_text(json.dumps({"seed": 11, "delta_v": OPTIMUM}))
        self.folder = folder / source
        given = ("--record", EPISODES, "--reference", folder / "ref.json", "--output", self.folder)
        self.printed = typed("evaluate", source, "--cfg", EXPERIMENT, *WORDS, *given)
        self.record = json.loads((self.folder / "evaluation.json").read_text())
        self.episodes, states = (dict(np.load(self.folder / f"{name}.npz")) for name in ("episodes", "trajectories"))
        self.trajectories = [starting(f"{episode}/", states) for episode in range(EPISODES)]
        self.flights = [self._fly(trajectory) for trajectory in self.trajectories]
        self.status = np.array([flight.status for flight in self.flights])
        rows = [figures_of(flight) for flight in self.flights]
        self.figures = {name: np.array([row[name] for row in rows], float) for name in rows[0]}
        self.figures[GAP] = self.figures["delta-v"] - np.array(OPTIMUM, float)

    @staticmethod
    def _fly(states: dict[str, np.ndarray]) -> Flight:
        deputy = OneDeputy(TASK, observes=False)
        deputy.reset(states["position"][0, 0], states["velocity"][0, 0], float(states["arrays/sun_angle"][0]))
        for thrust in states["control"][:, 0]:
            assert deputy.flight.status == "running"
            deputy.step(thrust)
        return deputy.flight
