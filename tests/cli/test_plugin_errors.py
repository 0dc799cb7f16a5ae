"""An error that a plugin raises is one message, with the lines of the plugin's own file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from safe_inspect.config.data import configs_root

PLUGIN = '''
from safe_inspect.rewards import Reward


class {name}(Reward):
    """Give a reward with a mistake."""

    scale: float = 1.0

    def __call__(self, step):
        """Return the reward."""
        return self.scaled(step)

    def scaled(self, step):
        """Return the reward."""
        return {line}
'''


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("self.scael", "AttributeError: '{name}' object has no attribute 'scael'"),
        ("open('weights.npz')", "FileNotFoundError: [Errno 2] No such file or directory: 'weights.npz'"),
        ("step.dt / 0", "ZeroDivisionError: float division by zero"),
        ("(_ for _ in ()).throw(BrokenPipeError('my device'))", "BrokenPipeError: my device"),
    ],
)
def test_an_error_of_a_plugin_is_one_message(
    typed: Callable[..., tuple[int, str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, text: str
) -> None:
    name = f"Failing{text.partition(':')[0]}"
    (tmp_path / f"{name}.py").write_text(PLUGIN.format(name=name, line=line))
    monkeypatch.syspath_prepend(tmp_path)
    cfg = str(configs_root() / "translational-inspection" / "experiment.yml")
    added = f"rewards+=[{{functor: {name}.{name}}}]"
    code, _, err = typed("evaluate", "ZeroThrust", "--cfg", cfg, "--episodes", "2", added)
    assert code == 2
    place = tmp_path / f"{name}.py"
    fix = "fix it, and test it with safe_inspect.testing.check_plugin"
    assert err.splitlines()[-1] == f"error: {text.format(name=name)}; raised in the reward {name} ({place}:16); {fix}"
    assert f'File "{place}", line 12, in __call__' in err
    assert "safe_inspect/environments" not in err
    assert "pydantic" not in err
