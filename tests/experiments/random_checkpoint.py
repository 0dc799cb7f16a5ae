"""A training run's folder with a sealed checkpoint of random weights, made without Ray's processes."""

from __future__ import annotations

import json

import yaml

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment

LEVELS = [-1.0, -0.1, 0.0, 0.1, 1.0]
SHIPPED = configs_root() / "translational-inspection" / "experiment-seed.yml"
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"


def experiment_of(change=None, path=SHIPPED, overrides=("horizon=60",)):
    """Return an experiment whose resolved tree `change` has changed."""
    tree = load_experiment(path, overrides).resolved
    if change is not None:
        for entry in tree["agent_config"]:
            change(entry["config"]["config"])
    return build_experiment(json.loads(json.dumps(tree)))


def controllers(agent):
    """Return the glues of the controllers in an agent's configuration."""
    return agent["glues"][0]["wrapped"]


def discrete(agent):
    """Let an agent choose among levels."""
    for index, glue in enumerate(controllers(agent)):
        glue["functor"] = "DiscreteControllerGlue"
        levels = LEVELS if index else LEVELS[1:4]
        glue["config"] = {"controller": glue["config"]["controller"], "levels": levels}


def scaled(agent):
    """Map the thrust, with uneven limits, and the observation of every sensor."""
    part = next(part for part in agent["parts"] if part.get("config", {}).get("name") == "Y Thrust")
    part["config"]["properties"] |= {"low": -0.5, "high": 2.0}
    first, second, third = controllers(agent)
    first["config"]["normalization"] = {"normalizer": "LinearNormalizer", "config": {"minimum": -2.0, "maximum": 2.0}}
    second["config"]["normalization"] = {"normalizer": "LinearNormalizer"}
    third["config"]["normalization"] = {"normalizer": "StandardNormalNormalizer", "config": {"mu": 0.1, "sigma": 0.5}}
    position, velocity, _, uninspected, sun = agent["glues"][1:]
    position["config"] |= {"output_units": "km"}
    position["config"]["normalization"]["config"] = {"mu": [0.1, 0.0, -0.05], "sigma": [0.1, 0.2, 0.3]}
    velocity["config"] |= {"output_units": "cm/s"}
    velocity["config"]["normalization"]["config"] = {"mu": 3.0, "sigma": 50.0}
    uninspected["config"]["normalization"] = {"normalizer": "LinearNormalizer", "config": {"minimum": 0.0}}
    sun["config"] |= {"output_units": "deg", "normalization": {"normalizer": "LinearNormalizer"}}


def make_module(agent, seed=0, module_class=None, **model):
    """Return RLlib's module with random weights whose actions vary over their whole range."""
    import dataclasses

    import torch
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from safe_inspect.environments.facades.spaces import action_space, box
    from safe_inspect.environments.layout import action_layout, observation_layout
    from safe_inspect.experiments.modules.policy import FreshPolicy

    torch.manual_seed(seed)
    settings = {"fcnet_hiddens": [32, 32], "fcnet_activation": "tanh", "vf_share_layers": False, **model}
    module = (module_class or FreshPolicy)(
        observation_space=box(observation_layout(agent)),
        action_space=action_space(action_layout(agent)),
        model_config=dataclasses.asdict(DefaultModelConfig(**settings)),
    )
    with torch.no_grad():
        module.pi.net.mlp[-1].weight *= 8.0
        module.pi.net.mlp[-1].bias *= 0.0
    return module


def save_run(folder, experiment, modules, keep_info=False):
    """Write a run's folder with one checkpoint of these modules, by the names of their policies; return that."""
    from safe_inspect.experiments.modules.checkpoints import INFO, Checkpoint
    from safe_inspect.experiments.settings.policies import policy_info

    outside = [agent for agent in experiment.spec.agents if agent.scripted_policy is None]
    checkpoint = folder / "tune" / "000" / "trial_00000" / "checkpoint_000003"
    for name, module in modules.items():
        agents = [agent for agent in outside if agent.policy == name] or outside
        if not keep_info:
            module.model_config[INFO] = policy_info(experiment, name, agents).metadata()
        module.save_to_path(str(checkpoint / "learner_group" / "learner" / "rl_module" / name))
    Checkpoint(checkpoint, 7, 28_000, 12.5, "d").seal()
    (folder / "experiment.resolved.yml").write_text(f"# From here\n{yaml.safe_dump(experiment.resolved)}")
    record = {"safe_inspect": "0.0.1", "seed": 4, "git_commit": "abc+", "python": "3.11", "digest": "d"}
    record |= {"configuration": {}, "attempts": [{"started": "2026-01-01T00:00:00+00:00", "host": "somewhere"}]}
    (folder / "run.json").write_text(json.dumps(record))
    return checkpoint


def single_run(folder, experiment, **model):
    """Write the run of a single agent, and return its checkpoint."""
    module = make_module(experiment.spec.agents[0], **model)
    return save_run(folder, experiment, {"default_policy": module})
