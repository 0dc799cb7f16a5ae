"""Values that the tests of the training share."""

from __future__ import annotations

MAKER = "dummy_environment:make"

#: A training of a second: small nets, few environments.
QUICK = {
    "num_envs_per_env_runner": 16,
    "train_batch_size_per_learner": 512,
    "minibatch_size": 256,
    "num_epochs": 1,
    "model_config": {"fcnet_hiddens": [16, 16]},
}
