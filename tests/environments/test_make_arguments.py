"""The arguments that environments are made with, and the names of agents: one message that says what is meant."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import safe_inspect
from safe_inspect.errors import AgentError, ArgumentError, ConfigError, PluginValueError, SafeInspectError
from safe_inspect.interrupts import Interrupted
from safe_inspect.rewards import Reward

ID = "safe_inspect/TranslationalInspection-v1"
TEAM = "safe_inspect/MultiagentTranslationalInspection-v1"


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"horizon": 5}, r"unexpected keyword argument 'horizon'; .* overrides=\['horizon=5'\]( was raised .*)?$"),
        ({"gamm": 0.9}, r"unexpected keyword argument 'gamm'; did you mean `gamma`\?( was raised .*)?$"),
        ({"enabled": True}, r"keyword argument 'enabled'; .*`enabled` fits 3 places; write one of `RTAGlueCWH"),
    ],
)
def test_a_keyword_that_is_not_taken_lists_what_it_may_mean(keywords, message):
    with pytest.raises(ArgumentError, match=message):
        gymnasium.make(ID, **keywords)


def test_the_limit_of_gymnasiums_wrapper_is_the_horizon_of_a_batch():
    with pytest.raises(TypeError, match=r"argument 'max_episode_steps'; .* overrides=\['horizon=10'\]"):
        gymnasium.make_vec(ID, num_envs=4, max_episode_steps=10)


@pytest.mark.parametrize("made", ["make", "make_vec", "make_parallel", "make_parallel_vec"])
def test_a_keyword_that_is_not_taken_is_a_type_error_in_pythons_words(made):
    with pytest.raises(TypeError, match=r"Env\(\) got an unexpected keyword argument 'frameskip'"):
        getattr(safe_inspect, made)(ID, frameskip=1)


@pytest.mark.parametrize("gamma", ["a", None, True, 1.5, float("nan")])
def test_a_discount_is_a_number_from_0_to_1(gamma):
    for made in (safe_inspect.make, safe_inspect.make_vec, safe_inspect.make_parallel):
        with pytest.raises(ArgumentError, match="gamma: a number from 0 to 1 is expected"):
            made(ID, gamma=gamma)


@pytest.mark.parametrize("slot", ["a", -1, 0.5, float("inf"), 2**70, True])
def test_a_slot_is_a_whole_number(slot):
    with pytest.raises(ArgumentError, match=r"^slot: a whole number from 0"):
        safe_inspect.make(ID, slot=slot)
    with pytest.raises(ArgumentError, match=r"^first_slot: a whole number from 0"):
        safe_inspect.make_vec(ID, first_slot=slot)


@pytest.mark.parametrize("overrides", ["horizon=5", {"horizon": 5}, [("horizon", 5)], 5])
def test_overrides_are_a_list_of_texts(overrides):
    with pytest.raises(ArgumentError, match=r'such as \["horizon=600"\]'):
        safe_inspect.make(ID, overrides)


def test_a_mistyped_autoreset_mode_names_the_nearest():
    with pytest.raises(ArgumentError, match=r"'nextstep'; did you mean `NextStep`"):
        safe_inspect.make_vec(ID, 2, autoreset_mode="nextstep")


def test_options_that_are_no_dictionary_are_refused():
    with pytest.raises(ArgumentError, match="a dictionary is expected, not 5"):
        safe_inspect.make(ID).reset(options=5)


@pytest.mark.parametrize("space", ["observation_space", "action_space"])
def test_an_unknown_agent_lists_the_known_ones(space):
    with pytest.raises(AgentError, match="controlled agent 'nobody'; known: `blue0_ctrl`"):
        getattr(safe_inspect.make_parallel(TEAM), space)("nobody")


class Ends(Reward):
    """Raises what a test asks for."""

    what: str

    def __call__(self, step):
        if self.what == "deep":
            return self(step)
        ends = {"exit": SystemExit(3), "generator": GeneratorExit(), "interrupt": KeyboardInterrupt()}
        raise ends.get(self.what, Interrupted(2))


def ended(what):
    environment = safe_inspect.make(ID, [f"rewards=[{{functor: {__name__}.Ends, config: {{what: {what}}}}}]"])
    environment.reset(seed=0)
    return environment.step(environment.action_space.sample())


@pytest.mark.parametrize(
    ("what", "shown"), [("generator", "raises GeneratorExit"), ("deep", "calls itself without end")]
)
def test_a_plugin_that_ends_otherwise_is_named(what, shown):
    with pytest.raises(PluginValueError, match=rf"the reward Ends {shown} \({__file__}:\d+: ") as error:
        ended(what)
    assert error.value.__suppress_context__  # of a thousand calls


@pytest.mark.parametrize("cfg", [None, 3, "", {"agent_config": {}}])
def test_what_is_no_configuration_is_refused(cfg):
    for make in (safe_inspect.make, safe_inspect.make_vec, safe_inspect.make_parallel):
        with pytest.raises(ConfigError, match="must be a file path or a task id, not"):
            make(cfg)


def test_a_plugin_that_ends_the_program_is_named():
    with pytest.raises(PluginValueError, match=rf"the reward Ends ends the program \({__file__}:\d+: raise"):
        ended("exit")


def test_a_plugin_that_raises_keyboard_interrupt_is_named_and_a_signal_is_not():
    with pytest.raises(KeyboardInterrupt) as raised:
        ended("interrupt")
    assert "raised in the reward Ends" in raised.value.__notes__[0]
    with pytest.raises(Interrupted) as stopped:
        ended("signal")
    assert not hasattr(stopped.value, "__notes__")


@pytest.mark.parametrize("made", ["make_vec", "make_parallel_vec"])
def test_the_number_of_environments_is_no_truth_value(made):
    with pytest.raises(ValueError, match="num_envs must be a whole number of at least 1, not True"):
        getattr(safe_inspect, made)(ID, num_envs=True)


@pytest.mark.parametrize("load", [safe_inspect.make, safe_inspect.load_experiment])
def test_an_override_is_a_text(load):
    with pytest.raises(SafeInspectError, match="None is no"):
        load(ID, [None])


def test_a_list_of_seeds_has_one_for_each_environment():
    environments = safe_inspect.make_vec(ID, 4)
    wanted, _ = environments.reset(seed=1)
    for seed in ([1, 2, 3, 4], (1, 2, 3, 4), np.array([1, 2, 3, 4])):
        np.testing.assert_array_equal(environments.reset(seed=seed)[0], wanted)
    for seed, count in (([1, 2], 2), ([], 0), (np.array([], dtype=int), 0)):
        with pytest.raises(ArgumentError, match=f"reset: {count} seeds are given for 4 environments"):
            environments.reset(seed=seed)
    with pytest.raises(ArgumentError, match="one seed serves all environments"):
        environments.reset(seed=[1, 1, 1, 1])


@pytest.mark.parametrize("made", ["make", "make_vec", "make_parallel", "make_parallel_vec"])
def test_a_closed_environment_takes_no_step_until_it_is_reset(made):
    environment = getattr(safe_inspect, made)(ID)
    environment.reset(seed=1)
    action = environment.action_space.sample() if made in ("make", "make_vec") else None
    if action is None:
        spaces = environment.action_spaces
        action = {agent: space.sample() for agent, space in spaces.items()}
    environment.step(action)
    environment.close()
    with pytest.raises(SafeInspectError, match=r"call reset\(\) first"):
        environment.step(action)
    environment.reset()
    environment.step(action)
