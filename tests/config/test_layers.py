"""Experiments that are another one and what differs from it."""

from __future__ import annotations

import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import ConfigError

BASE = "- !include configs/docking/experiment.yml\n"


@pytest.fixture
def layered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def load(text, *overrides):
        (tmp_path / "experiment.yml").write_text(BASE + text)
        return load_experiment("experiment.yml", overrides)

    return load


def rewards(experiment):
    return {named.name: named.functor for named in experiment.spec.agents[0].rewards}


def test_short_keys_mean_their_places(layered):
    short = layered(
        "- env_config: {horizon: 99}\n"
        "  tune_config: {stop: {num_env_steps_sampled_lifetime: 7}}\n"
        "  blue0_ctrl:\n"
        "    rewards: {DockingDeltaVReward: {config: {scale: -0.5}}}\n"
        "    parts+: [{part: Sensor_SunAngle}]\n"
        "    policy: {config: {gamma: 0.5}}\n"
        "  platform_config: {blue0: {config: {config: {mass: 13}}}}\n",
        "~parts.Sensor_SunAngle",
    )
    long = layered(
        "- config: {config: {env_config: {horizon: 99}, tune_config: {stop: {num_env_steps_sampled_lifetime: 7}}}}\n"
        "  platform_config: {blue0: {config: {config: {mass: 13}}}}\n"
        "  agent_config:\n"
        "    blue0_ctrl:\n"
        "      config: {config: {rewards: {DockingDeltaVReward: {config: {scale: -0.5}}}}}\n"
        "      policy: {config: {gamma: 0.5}}\n"
    )
    assert short.spec == long.spec
    assert short.rllib == long.rllib
    assert rewards(short)["DockingDeltaVReward"].scale == -0.5
    assert short.spec.platforms["blue0"].mass == 13.0
    assert short.rllib["gamma"] == 0.5
    assert short.config.config.config.tune_config["stop"] == {"num_env_steps_sampled_lifetime": 7}


def test_later_layers_and_layers_of_layers_win(layered, tmp_path):
    dones = "[{functor: ContactDoneFunction}]"
    (tmp_path / "more.yml").write_text(f"- env_config: {{horizon: 5}}\n- blue0_ctrl: {{dones+: {dones}}}\n")
    experiment = layered("- env_config: {horizon: 6}\n- !include ./more.yml\n", "~dones.ContactDoneFunction")
    assert experiment.config.config.config.env_config.horizon == 5


@pytest.mark.parametrize("file", ["[!include FILE]", "!include FILE ", "FILE"])
def test_an_agent_of_files_and_of_short_keys_has_both(layered, file):
    experiment = layered(
        "- agent_config:\n"
        "    - name: blue0_ctrl\n"
        "      platforms: [blue0]\n"
        f"      config: {file.replace('FILE', 'configs/translational-inspection/agent.yml')}\n"
        "      rewards: []\n"
        "      parts+: [{part: Sensor_Speed}]\n"
        "  env_config: !include configs/translational-inspection/environment.yml\n"
    )
    assert rewards(experiment) == {}
    assert "Sensor_Speed" in experiment.spec.agents[0].parts


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- rewards: []\n", r"experiment.yml:2.*unknown key `rewards`"),
        ("- blu0_ctrl: {}\n", r"experiment.yml:2.*unknown key `blu0_ctrl`; did you mean `blue0_ctrl`"),
        ("- env_confg: {}\n", r"experiment.yml:2.*unknown key `env_confg`; did you mean `env_config`"),
        ("- blue0_ctrl: {rewards: {DockingReward: {}}}\n", r"experiment.yml:2.*the list has no item named"),
        ("- blue0_ctrl: {rewards: {DockingDeltaVReward: {config: {scael: 1}}}}\n", r"experiment.yml:2.*scael"),
        ("- blue0_ctrl: 5\n", r"experiment.yml:2.*expected a mapping, got 5"),
        ("- {config: 5, env_config: {horizon: 3}}\n", "item 0 of a merged list must be a mapping, not 5"),
        ("- {config: ./nowhere.yml, env_config: {horizon: 3}}\n", "does not exist: './nowhere.yml'"),
        ("- 5\n", "not an experiment"),
        ("- env_config+: []\n", "`env_config`, to which it appends, must be a list"),
    ],
)
def test_a_mistake_stands_where_it_is_written(layered, text, words):
    with pytest.raises(ConfigError, match=words):
        layered(text)


def test_a_list_that_replaced_the_included_one_is_named_if_something_is_missing(layered):
    with pytest.raises(ConfigError, match="no controller is named") as caught:
        layered("- blue0_ctrl:\n    parts: [{part: Sensor_Position}]\n")
    last = str(caught.value.problems[-1])
    assert last.startswith("experiment.yml:3 agent_config[0].config.config.parts: this list replaces that of ")
    assert "configs/docking/experiment.yml:" in last
    assert "`parts+: [...]`" in last
    with pytest.raises(ConfigError, match="the key is missing") as caught:
        layered("- agent_config:\n    - {policy: {}}\n")
    assert "agent_config: this list replaces that of" in str(caught.value.problems[-1])
    with pytest.raises(ConfigError) as caught:
        layered("- blue0_ctrl:\n    parts: [{part: Sensor_Position}]\n    rewards: 5\n")
    assert "replaces" not in str(caught.value)
