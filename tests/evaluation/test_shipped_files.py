"""The files of the shipped policies: the distribution of their actions, and records that are damaged."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from safe_inspect.errors import CheckpointError
from safe_inspect.evaluation.shipped import RECORD, shipped_policies, shipped_policy

pytest.importorskip("onnxruntime", reason="pip install 'safe_inspect[onnx]'")


@pytest.mark.parametrize("name", shipped_policies())
def test_the_distribution_takes_the_outputs_of_the_net(name: str) -> None:
    for policy in shipped_policy(name).load().values():
        outputs = {output.name: output.shape[-1] for output in policy._session.get_outputs()}
        assert policy.distribution.inputs == outputs["action_dist_inputs"], outputs
        assert policy.distribution.width == len(policy.info.action)


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"agents": ["blue0"]}'])
def test_a_damaged_record_is_one_message(content: str, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    record = tmp_path / "mine" / RECORD
    record.write_text(content)
    with pytest.raises(CheckpointError, match=rf"^{re.escape(str(record))}: the record of the policy is damaged \("):
        shipped_policy("mine", tmp_path)
    record.write_text(json.dumps({"agents": {"blue0": "policy.onnx"}}))
    assert shipped_policy("mine", tmp_path).onnx == {"blue0": tmp_path / "mine" / "policy.onnx"}
