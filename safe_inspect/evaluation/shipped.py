"""The trained policies that are part of the package: `safe_inspect/policies/trained/<name>/`.

Each folder contains the files that `scripts/ship_policy.py` writes: an ONNX file for each policy, `policy.json` with
the agents that it controls, `card.md`, `experiment.resolved.yml`, and `checkpoint/` with the weights.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from safe_inspect.errors import CheckpointError, SafeInspectError, did_you_mean
from safe_inspect.evaluation.onnx_policy import OnnxPolicy, load_onnx
from safe_inspect.evaluation.policies import BASELINES

#: The names of the files in the folder of a shipped policy.
RECORD, CARD, CONFIGURATION, CHECKPOINT = "policy.json", "card.md", "experiment.resolved.yml", "checkpoint"

_ROOT = Path(__file__).resolve().parents[1] / "policies" / "trained"


@dataclass(frozen=True)
class ShippedPolicy:
    """A trained policy of the package.

    Attributes:
        name: Its name.
        folder: Its folder.
        onnx: The ONNX file of each agent, by the agent's name; agents that share a policy share the file.
    """

    name: str
    folder: Path
    onnx: Mapping[str, Path]

    @property
    def card(self) -> Path:
        """The model card in Markdown: how the policy was trained, what it achieves, and where it must not be used."""
        return self.folder / CARD

    @property
    def experiment(self) -> Path:
        """The complete experiment file with which it was trained."""
        return self.folder / CONFIGURATION

    @property
    def checkpoint(self) -> Path:
        """The checkpoint, with only the weights: for `load_policy` and policies that start from a checkpoint."""
        return self.folder / CHECKPOINT

    @property
    def training(self) -> Mapping[str, str]:
        """Entries on the training in the model card's first table, such as ``wall time``; empty without a card."""
        try:
            rows = re.findall(r"^\| ([^|]+) \| ([^|]*) \|$", self.card.read_text(encoding="utf-8"), re.MULTILINE)
        except OSError:
            return {}
        return dict(reversed([(name.strip(), value.strip()) for name, value in rows]))

    def load(self, sampled: bool | None = None, seed: int = 0) -> dict[str, OnnxPolicy]:
        """Return the policy of each agent, by the agent's name; see `load_onnx`.

        Raises:
            CheckpointError: An ONNX file is missing or damaged.
            SafeInspectError: Onnxruntime is not installed.
        """
        loaded = {path: load_onnx(path, sampled, seed) for path in sorted(set(self.onnx.values()))}
        return {agent: loaded[path] for agent, path in self.onnx.items()}


def shipped_policies(root: Path | None = None) -> tuple[str, ...]:
    """Return the names of the policies that are part of the package.

    Args:
        root: Folder of the policies; the package's own by default.
    """
    root = _ROOT if root is None else root
    return tuple(sorted(path.parent.name for path in root.glob(f"*/{RECORD}")))


def shipped_policy(name: str, root: Path | None = None) -> ShippedPolicy:
    """Return a policy that is part of the package.

    Args:
        name: Its name.
        root: Folder of the policies; the package's own by default.

    Raises:
        SafeInspectError: There is no policy of that name.
        CheckpointError: Its record is damaged.
    """
    root = _ROOT if root is None else root
    names = shipped_policies(root)
    if name not in names:
        hint = "it is a scripted policy: give it as a separate argument, without `--policy`"
        hint = hint if name in BASELINES else did_you_mean(name, names)
        raise SafeInspectError(f"no shipped policy {name!r}; {hint}")
    record = root / name / RECORD
    try:
        agents = json.loads(record.read_text(encoding="utf-8"))["agents"]
        files = {str(agent): root / name / str(file) for agent, file in agents.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(
            f"{record}: the record of the policy is damaged ({error}); reinstall the package"
        ) from None
    return ShippedPolicy(name, root / name, files)
