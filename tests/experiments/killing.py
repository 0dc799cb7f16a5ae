"""A callback that kills the process of a runner, as the system does when memory runs out."""

from __future__ import annotations

import os
import signal

from ray.rllib.callbacks.callbacks import RLlibCallback


class Killing(RLlibCallback):
    """Kills the first runner after its third sample."""

    samples = 0

    def on_sample_end(self, *, env_runner, **_):
        self.samples += 1
        if env_runner.worker_index == 1 and self.samples == 3:
            os.kill(os.getpid(), signal.SIGKILL)
