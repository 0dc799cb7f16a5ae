"""The peer's published environment and agent files load as they are and give the same environment as ours.

Their text is no part of this repository. It is looked for in `shared/seeds` beside it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment

PUBLISHED = sorted((Path(__file__).parents[3] / "shared" / "seeds").glob("000_*.txt"))


def blocks(text: str) -> dict[str, str]:
    """Return the two files that the page quotes; the environment is the inside of a mapping in braces."""
    begin = text.index('"simulator": {')
    middle = text.index("Agent Config\n", begin)
    agent = text.index('"agent":', middle)
    end = text.index("\nReferences\n", agent)
    return {"environment.yml": "{\n" + text[begin:middle] + "}\n", "agent.yml": text[agent:end].rstrip() + "\n"}


@pytest.mark.skipif(not PUBLISHED, reason="the published files are not in shared/seeds beside the repository")
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
