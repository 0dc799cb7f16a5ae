"""What the tests of the training share: a small environment without physics, and one Ray."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

import pytest

HERE = Path(__file__).parent
if str(HERE) not in sys.path:  # Ray's processes import `dummy_environment` too
    sys.path.insert(0, str(HERE))

from algorithms import build  # noqa: E402
from training_values import MAKER, QUICK  # noqa: E402


@pytest.fixture(scope="session")
def ray_session():
    """Start one Ray for all the tests that do not need to kill it."""
    from safe_inspect.experiments.runs import cluster

    cluster.set_environment()
    import ray

    folder = tempfile.mkdtemp(prefix="si-", dir="/tmp")
    paths = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE), *filter(None, [paths])])
    with cluster.patient_start():
        ray.init(
            address="local",
            num_cpus=4,
            object_store_memory=128 * 2**20,
            include_dashboard=False,
            log_to_driver=False,
            logging_level="ERROR",
            _temp_dir=folder,
        )
    yield
    ray.shutdown()
    if paths is None:
        os.environ.pop("PYTHONPATH")
    else:
        os.environ["PYTHONPATH"] = paths
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def quick():
    """Return settings of a training of a second."""
    return dict(QUICK)


@pytest.fixture
def maker():
    """Return the name of the maker of the small environment."""
    return MAKER


@pytest.fixture
def algorithm(ray_session, tmp_path, monkeypatch):
    """Return a function that builds an algorithm, without Tune."""
    from ray.tune.trainable import trainable

    monkeypatch.setattr(trainable, "DEFAULT_STORAGE_PATH", str(tmp_path))  # else in the home folder, without Tune
    built = []

    def make(*arguments, **more):
        config = build(*arguments, **more)
        built.append(config.build_algo())
        return built[-1]

    yield make
    for item in built:
        item.stop()
