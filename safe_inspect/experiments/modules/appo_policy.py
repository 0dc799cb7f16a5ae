"""`AppoPolicy`: the policy that APPO trains. Importing this module loads Ray and Torch."""

from __future__ import annotations

from ray.rllib.algorithms.appo.torch.default_appo_torch_rl_module import DefaultAPPOTorchRLModule

from safe_inspect.experiments.modules.saved_policy import SavedPolicy


class AppoPolicy(SavedPolicy, DefaultAPPOTorchRLModule):  # type: ignore[misc]
    """RLlib's policy for APPO."""
