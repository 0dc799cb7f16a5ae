"""Rendezvous missions whose figures are on record."""

from __future__ import annotations

from safe_inspect.config.data import configs_root
from safe_inspect.missions.mission import Mission
from safe_inspect.rendezvous.experiment import load_rendezvous

#: Each mission: its experiment, its overrides, and the relative tolerance of its figures; an estimator makes of a
#: difference in the last bit one of some percent.
MISSIONS = {
    "truth": ("experiment-truth.yml", (), 0.01),
    "orbit": ("experiment-orbit.yml", (), 0.01),
    "estimated": ("experiment.yml", ("seed=3",), 0.1),
    "estimated, camera silent for a while": (
        "experiment.yml",
        ("seed=3", "mission.faults=[{kind: camera, start: 45 s, duration: 6 s}]"),
        0.1,
    ),
}
FIGURES = (
    "success", "cause", "time", "time_on_approach", "least_clearance", "mating_position_error", "mating_speed_error",
    "delta_v", "largest_force", "largest_gauge", "plans", "tumble_axis", "tumble_rate", "keep_in_excursion",
)  # fmt: skip
#: Figures that a single moment or the last millimetres of an approach determine.
EXTREMES = ("largest_force", "largest_gauge", "mating_position_error", "mating_speed_error", "keep_in_excursion")


def figures(mission: str) -> dict[str, bool | str | float]:
    """Fly a mission and return its figures; the unit of each is that of the mission's summary.

    Args:
        mission: Name of the mission.
    """
    file, overrides, _ = MISSIONS[mission]
    experiment = load_rendezvous(configs_root() / "tumbling-rendezvous" / file, overrides)
    summary = Mission(experiment.config, experiment.config.seed).run().summary
    return {name: summary[name] for name in FIGURES}
