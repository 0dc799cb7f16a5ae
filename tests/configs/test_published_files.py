"""Published environment and agent files of safe-autonomy-sims load unchanged and give the same environment as ours.

Their text is not part of this repository. It is expected in `shared/seeds` next to the repository.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment

SEEDS = Path(__file__).parents[3] / "shared" / "seeds"
PUBLISHED = sorted(SEEDS.glob("000_*.txt"))
PUBLISHED_TEAM = sorted(SEEDS.glob("002_*.txt"))
SUCCESS = "success_function_name=SuccessfulInspectionDoneFunction"


def blocks(text: str) -> dict[str, str]:
    """Return the two files that the page quotes; the environment is the inside of a mapping in braces."""
    begin = text.index('"simulator": {')
    middle = text.index("Agent Config\n", begin)
    agent = text.index('"agent":', middle)
    end = text.index("\nReferences\n", agent)
    environment = text[begin:middle].rstrip()
    return {"environment.yml": "{\n" + environment + "\n}\n", "agent.yml": text[agent:end].rstrip() + "\n"}


@pytest.mark.skipif(not PUBLISHED, reason="the published files are not in shared/seeds next to the repository")
def test_the_published_files_give_the_same_environment(copied, shipped):
    ours = load_experiment(shipped)
    for name, text in blocks(PUBLISHED[0].read_text(encoding="utf-8")).items():
        assert "safe_autonomy_sims" in text
        (copied / name).write_text(text)
    theirs = load_experiment(copied / "experiment.yml")
    assert theirs.tree is not ours.tree
    environments = [BatchedEnvironment(experiment.spec, 16, seed=11) for experiment in (ours, theirs)]
    first, second = (env.reset() for env in environments)
    np.testing.assert_array_equal(first, second)
    thrusts = np.random.default_rng(7).uniform(-0.5, 0.5, (50, 16, 1, 3))
    for thrust in thrusts:
        one, two = (env.step(thrust) for env in environments)
        np.testing.assert_array_equal(one.observation, two.observation)
        np.testing.assert_array_equal(one.status, two.status)
        np.testing.assert_array_equal(one.truncated, two.truncated)
        assert one.terms.keys() == two.terms.keys()
        for name, term in one.terms.items():
            np.testing.assert_array_equal(term, two.terms[name])
    for name, array in environments[0].state.arrays.items():
        np.testing.assert_array_equal(array, environments[1].state.arrays[name])
    assert environments[0].state.points["chief"].team_count.min() > 0


@pytest.mark.skipif(not PUBLISHED_TEAM, reason="the published files are not in shared/seeds next to the repository")
def test_the_published_files_of_several_agents_load_with_a_note_on_a_name_that_nobody_has(copied, long_form):
    ours = copied.parent / "multiagent-translational-inspection"
    shutil.copytree(long_form / ours.name, ours)
    expected = load_experiment(ours / "experiment-seed.yml")
    for name, text in blocks(PUBLISHED_TEAM[0].read_text(encoding="utf-8")).items():
        assert "safe_autonomy_sims" in text
        (ours / name).write_text(text)
    experiment = (ours / "experiment-seed.yml").read_text()
    agent = "!include configs/translational-inspection/agent-seed.yml"
    assert agent in experiment
    published = ours / "published.yml"
    published.write_text(experiment.replace(agent, "!include ./agent.yml"))
    with pytest.warns(UserWarning, match="no agent has a done function named 'SafeSuccessfulInspectionDoneFunction'"):
        theirs = load_experiment(published)
    assert load_experiment(published, [SUCCESS]).spec != theirs.spec
    assert [agent.name for agent in theirs.spec.agents] == [agent.name for agent in expected.spec.agents]
    first, second = (BatchedEnvironment(experiment.spec, 16, seed=11) for experiment in (expected, theirs))
    seen, also = first.reset(), second.reset()
    # Their sensors all name blue0, and so all agents see its count; ours see their own.
    count = first.observation_layout.names.index("Sensor_InspectedPoints.n_inspected")
    others = [index for index in range(seen.shape[-1]) if index != count]
    np.testing.assert_array_equal(seen[:, 0], also[:, 0])
    np.testing.assert_array_equal(also[:, 1:, count], np.repeat(also[:, :1, count], 2, axis=1))
    thrusts = np.random.default_rng(7).uniform(-0.2, 0.2, (30, 16, 3, 3))
    for thrust in thrusts:
        one, two = first.step(thrust), second.step(thrust)
        np.testing.assert_array_equal(one.observation[..., others[:6]], two.observation[..., others[:6]])
        np.testing.assert_array_equal(one.status, two.status)
        for name, term in one.terms.items():
            np.testing.assert_array_equal(term, two.terms[name])
    np.testing.assert_array_equal(first.state.position, second.state.position)
