"""Public test kit: `check_plugin` checks a plugin against the contract of all plugins.

It needs no test framework::

    from safe_inspect.testing import check_plugin

    def test_my_reward_satisfies_the_contract():
        check_plugin(MyReward)
"""

from safe_inspect.testing.contract import check_plugin
from safe_inspect.testing.flights import take_rows
from safe_inspect.testing.report import Breach, ContractError
from safe_inspect.testing.samples import sample_spec, sample_steps, sample_team_steps

__all__ = ["Breach", "ContractError", "check_plugin", "sample_spec", "sample_steps", "sample_team_steps", "take_rows"]
