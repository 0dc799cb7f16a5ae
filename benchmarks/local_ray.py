"""A Ray of one's own for the time of a benchmark."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

from safe_inspect.experiments.runs import cluster


@contextmanager
def local_ray() -> Iterator[None]:
    """Start Ray with its files in a temporary folder, and end it."""
    cluster.set_environment()
    import ray
    from ray.tune.trainable import trainable

    with tempfile.TemporaryDirectory(prefix="si-") as folder:
        trainable.DEFAULT_STORAGE_PATH = folder
        ray.init(
            address="local",
            include_dashboard=False,
            log_to_driver=False,
            logging_level="ERROR",
            object_store_memory=128 * 2**20,
            _temp_dir=folder,
        )
        try:
            yield
        finally:
            ray.shutdown()
