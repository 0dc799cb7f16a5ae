"""Connectors and RLModules by their dotted paths."""

from __future__ import annotations

import pytest
from algorithms import build
from dummy_environment import ONE
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.settings.translation import translate_rllib

FILTER = "ray.rllib.connectors.env_to_module.MeanStdFilter"
STACK = {"functor": "ray.rllib.connectors.common.frame_stacking.FrameStacking", "config": {"num_frames": 2}}
SHIPPED = str(configs_root() / "translational-inspection" / "experiment.yml")
DUMMY = {"team": ONE}


class Deep(DefaultPPOTorchRLModule):
    """A policy of one's own."""


def refusing(depth):
    """Make nothing without a depth."""


def test_a_module_of_ones_own_gets_its_config():
    spec = build(DUMMY, rl_module={"functor": f"{__name__}.Deep", "config": {"depth": 3}}).rl_module_spec
    assert spec.module_class.__name__ == "Deep"
    assert (spec.model_config["depth"], spec.model_config["vf_share_layers"]) == (3, False)


def test_connectors_are_built_for_each_pipeline():
    keys = {"env_to_module_connector": [FILTER], "learner_connector": STACK, "module_to_env_connector": []}
    settings = translate_rllib(keys)
    assert (settings.settings["env_runner"], settings.settings["learner"]) == ("stock", "stock")
    assert len(settings.notes) == 2
    config = build(DUMMY, **keys)
    (connector,) = config._env_to_module_connector(None, None, None)
    assert type(connector).__name__ == "MeanStdFilter"
    (connector,) = config._learner_connector(None, None)
    assert connector.num_frames == 2
    assert config._module_to_env_connector is None


@pytest.mark.parametrize(
    ("keys", "shown"),
    [
        ({"rl_module": "ray.rllib.connectors.connector_v2.ConnectorV2"}, "ConnectorV2' is not an RLModule of RLlib"),
        ({"rl_module": "no_such_module.Module"}, "no module 'no_such_module'"),
        ({"env_to_module_connector": f"{__name__}.Deep"}, "rllib_configs.env_to_module_connector"),
        ({"learner_connector": f"{__name__}.refusing"}, "refusing rejects its `config`: .*depth"),
        ({"module_to_env_connector": "ray.rllib.connectors.Nothing"}, "has no 'Nothing'"),
    ],
)
def test_what_cannot_be_built_is_one_message(keys, shown):
    with pytest.raises(ConfigError, match=shown):
        build(DUMMY, **keys)


def test_it_is_reported_before_the_training_that_no_file_holds_them(capsys):
    override = f"agent_config.0.policy.config.env_to_module_connector={FILTER}"
    assert main(["validate", SHIPPED, override]) == 0
    shown = capsys.readouterr().err
    assert "policies can be trained, but not evaluated: no policy file can contain the code of `env_to_" in shown
    assert main(["validate", SHIPPED, f"agent_config.0.policy.config.rl_module={__name__}.Deep"]) == 0
    assert "the code of `rl_module`" in capsys.readouterr().err


def test_the_replay_buffer_of_sac_and_dqn_is_a_key():
    assert not translate_rllib({"algorithm": "DQN", "replay_buffer_config": {"capacity": 9}}).problems
    (problem,) = translate_rllib({"algorithm": "DQN", "replay_buffer_config": 5}).problems
    assert "expected a mapping" in problem.message
    (problem,) = translate_rllib({"algorithm": "DQN", "epsilon": "abc"}).problems
    assert "expected a number or a list" in problem.message
    (problem,) = translate_rllib({"algorithm": "DQN", "replay_sequence_length": 3}).problems
    assert problem.message == "there is no key `replay_sequence_length`"
