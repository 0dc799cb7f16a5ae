from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError, MissingLibraryError
from safe_inspect.rendezvous.experiment import build_rendezvous, load_rendezvous
from safe_inspect.rendezvous.libraries import require

SHIPPED = configs_root() / "tumbling-rendezvous" / "experiment-truth.yml"


def test_the_shipped_experiment_loads_with_units_and_includes() -> None:
    config = load_rendezvous(SHIPPED).config
    assert config.target.mating_point == (0.25, 0.0, 0.42)
    assert config.chaser.limits.force == 0.3
    assert config.chaser.actuator.force_noise == pytest.approx(3e-3)
    assert config.mission.step == pytest.approx(0.2)
    assert config.mission.update_period == pytest.approx(1.0)
    assert config.tumble.rate == pytest.approx(0.0872664626)


def test_what_is_resolved_loads_again_as_the_same_experiment(tmp_path: Path) -> None:
    experiment = load_rendezvous(SHIPPED, ["tumble.config.rate=3 deg/s"])
    (tmp_path / "resolved.yml").write_text(experiment.text)
    again = load_rendezvous(tmp_path / "resolved.yml")
    assert again.config == experiment.config
    assert yaml.safe_load(again.text) == yaml.safe_load(experiment.text)


def test_every_mistake_is_reported_with_file_line_and_path(tmp_path: Path) -> None:
    folder = tmp_path / "configs"
    folder.mkdir()
    (folder / "chaser.yml").write_text("mass: 9 kg\nlimits:\n  forse: 0.3 N\n")
    (folder / "experiment.yml").write_text(
        "seed: -1\nchaser: !include ./chaser.yml\ntarget: {functor: EnvisatTraget}\n"
        "tumble: {functor: TriAxialTumble, config: {rate: 5 m}}\n"
    )
    with pytest.raises(ConfigError) as caught:
        load_rendezvous(folder / "experiment.yml")
    text = str(caught.value)
    assert "experiment.yml:1 seed:" in text
    assert "chaser.yml:3 chaser.limits.forse: unknown key `forse`; did you mean `force`?" in text
    assert (
        "experiment.yml:3 target.functor: unknown target_model 'EnvisatTraget'; did you mean `EnvisatTarget`?" in text
    )
    assert "experiment.yml:4 tumble.config.rate:" in text
    assert len(caught.value.problems) == 4


def test_overrides_are_checked() -> None:
    with pytest.raises(ConfigError, match=r"mission\.observ: unknown key `observ`; did you mean `observe`"):
        load_rendezvous(SHIPPED, ["mission.observ=3"])
    with pytest.raises(ConfigError, match="planned_force"):
        load_rendezvous(SHIPPED, ["chaser.limits.planned_force=0.4 N"])
    with pytest.raises(ConfigError, match="multiple of control_ticks"):
        load_rendezvous(SHIPPED, ["mission.update_ticks=130"])
    with pytest.raises(ConfigError, match=r"plans are sampled every 0\.2 s"):
        load_rendezvous(SHIPPED, ["mission.tick=10 ms"])
    with pytest.raises(ConfigError, match=r"durations: 60\.1 s is no multiple"):
        load_rendezvous(SHIPPED, ["mission.durations=[60.1 s]"])


def test_a_library_that_is_not_installed_is_named_with_the_extra() -> None:
    with pytest.raises(MissingLibraryError, match=r"pip install \.\[rendezvous\]"):
        require("no_such_library")


def test_a_file_of_another_kind_is_named() -> None:
    with pytest.raises(ConfigError, match="no rendezvous experiment: it has the keys"):
        load_rendezvous(SHIPPED.with_name("chaser.yml"))
    assert build_rendezvous({}).config.seed == 0
