"""`SacPolicy`: the policy that SAC trains. Importing this module loads Ray and Torch."""

from __future__ import annotations

from ray.rllib.algorithms.sac.torch.default_sac_torch_rl_module import DefaultSACTorchRLModule

from safe_inspect.experiments.modules.saved_policy import SavedPolicy

#: Key of RLlib's `model_config` that only SAC policies have: whether there are two Q-functions.
TWIN_Q = "twin_q"


class SacPolicy(SavedPolicy, DefaultSACTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for SAC."""
