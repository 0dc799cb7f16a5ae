from __future__ import annotations

import numpy as np
import pytest

from .flown import Flown


@pytest.fixture(scope="session")
def flown(tmp_path_factory) -> dict[str, Flown]:
    """Return evaluations of the scripted inspector and of random thrust."""
    folder = tmp_path_factory.mktemp("flown")
    found = {source: Flown(source, folder) for source in ("inspector", "random")}
    ends = np.concatenate([one.status for one in found.values()])
    assert set(ends) == {"win", "lose", "draw"}
    return found
