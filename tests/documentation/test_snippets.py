"""The Python blocks of README and docs run, and their commands parse and name experiments and keys that exist."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from safe_inspect import train_rl
from safe_inspect.cli import main as cli
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.evaluation.shipped import shipped_policy
from safe_inspect.rendezvous.experiment import is_rendezvous, load_rendezvous

from .blocks import Block, blocks_of, run_command

_ROOT = Path(__file__).parents[2]
_PAGES = [_ROOT / "README.md", *sorted((_ROOT / "docs").glob("*.md"))]
_ID = {page: page.relative_to(_ROOT).as_posix() for page in _PAGES}
#: What a page shows of files that the reader has and the test has not, or that take a reader minutes.
_REPLACE = {
    'env = gymnasium.wrappers.RecordVideo(env, "videos")  # needs moviepy': "",
    "episodes=1000": "episodes=2",
    "my/experiment.yml": str(configs_root() / "docking" / "experiment.yml"),
    "num_envs=1024": "num_envs=2",
}


#: Its block needs minutes; tests/policies/test_baselines.py flies a plan.
_ELSEWHERE = ("docs/baselines.md",)


def _needs(folder: Path, page: str) -> None:
    """Write the files that commands of the page make."""
    if page == "docs/export.md":
        pytest.importorskip("onnxruntime")
        shutil.copy(shipped_policy("translational-inspection").onnx["blue0_ctrl"], folder / "policy.onnx")
    if page == "docs/evaluation.md":
        told = ["evaluate", "zero-thrust", "--episodes", "2", "--record", "1", "--output", "results/trained"]
        assert cli.main([*told, "--cfg", "configs/docking/experiment.yml"]) == 0


def _blocks(language: str, leave_out: tuple[str, ...] = ()) -> list[object]:
    return [
        pytest.param(
            page,
            [block for block in blocks_of(page) if block.language == language],
            id=_ID[page],
            marks=[pytest.mark.slow] if (language, _ID[page]) == ("python", "docs/figures.md") else [],
        )
        for page in _PAGES
        if any(block.language == language for block in blocks_of(page)) and _ID[page] not in leave_out
    ]


@pytest.mark.parametrize(("page", "blocks"), _blocks("python", _ELSEWHERE))
def test_the_python_blocks_of_a_page_run(page, blocks, monkeypatch, tmp_path, clean_registry) -> None:
    monkeypatch.chdir(tmp_path)
    _needs(tmp_path, _ID[page])
    names = {"__name__": "my_module"}
    monkeypatch.setitem(sys.modules, "my_module", type(sys)("my_module"))
    for block in blocks:
        text = block.text
        for old, new in _REPLACE.items():
            text = text.replace(old, new)
        exec(compile(text, str(page), "exec"), names)


@pytest.mark.parametrize(("page", "blocks"), _blocks("bash"))
def test_the_commands_of_a_page_parse_and_their_keys_exist(page, blocks: list[Block], monkeypatch) -> None:
    parsed = []
    for module in (cli, train_rl):
        monkeypatch.setattr(module, "run_command", lambda run, arguments: parsed.append(arguments) or 0)
    monkeypatch.chdir(_ROOT)
    for block in blocks:
        for words in block.commands():
            if any(word.startswith("[") for word in words):  # the form of a command, such as [--cfg FILE]
                continue
            assert run_command(words) == 0
            cfg = getattr(parsed[-1], "cfg", None)
            if cfg is None or not Path(cfg).is_file():
                continue
            load = load_rendezvous if is_rendezvous(cfg) else load_experiment
            load(cfg, getattr(parsed[-1], "overrides", ()) or ())
    assert parsed or not any(block.commands() for block in blocks)
