"""The public test kit: `check_plugin` holds a plugin against the contract that every plugin keeps.

It needs no test framework::

    from safe_inspect.testing import check_plugin

    def test_my_reward_keeps_the_contract():
        check_plugin(MyReward)
"""

from safe_inspect.testing.contract import check_plugin
from safe_inspect.testing.report import Breach, ContractError
from safe_inspect.testing.samples import sample_spec, sample_steps, sample_team_steps, take_rows

__all__ = [
    "Breach",
    "ContractError",
    "check_plugin",
    "sample_spec",
    "sample_steps",
    "sample_team_steps",
    "take_rows",
]
