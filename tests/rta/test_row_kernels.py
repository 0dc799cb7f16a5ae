"""The row kernels that certifying filters ask agree with the constraints that bring them."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.compiling import njit
from safe_inspect.rta.backup.sequences import SAFE, bits_of, broken_at, slack_of
from safe_inspect.rta.constraints import constraint_set
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.rows import Margins, node
from safe_inspect.rta.constraints.sets import CERTIFIED, NAMES, PSM
from safe_inspect.rta.filters import probe_states

PARAMETERS = ConstraintParameters()
KERNELS = [code for code in range(len(CERTIFIED)) if code != PSM]


@njit
def _broken(numbers, x, sun, margins):
    return broken_at(numbers, node(x, sun), margins)


@njit
def _slack(numbers, code, x, sun):
    return slack_of(numbers, code, node(x, sun))


def numbers(*chosen):
    constraints = constraint_set(PARAMETERS, chosen)
    return tuple(constraint.row_numbers(PARAMETERS.n, constraints) for constraint in CERTIFIED)


def rows():
    state = probe_states(300)
    for i in range(len(state)):
        angle = state.sun_angle[i]
        yield (*state.position[i].tolist(), *state.velocity[i].tolist()), (float(np.cos(angle)), float(np.sin(angle)))


@pytest.mark.parametrize("code", KERNELS, ids=[NAMES[code] for code in KERNELS])
def test_a_state_is_broken_and_without_slack_where_phi_is_negative(code):
    phi = constraint_set(PARAMETERS, [NAMES[code]])[NAMES[code]].phi(probe_states(300))
    assert 0 < (phi < 0.0).sum() < 300
    alone = numbers(NAMES[code])
    for value, (x, sun) in zip(phi, rows(), strict=True):
        assert _broken(alone, x, sun, Margins(0.0, 0.0, 0.0)) == (code if value < 0.0 else SAFE)
        assert (_slack(alone, code, x, sun) < 0.0) == (value < 0.0)


def test_constraints_that_do_not_count_refuse_nothing():
    assert all(_broken(numbers(), x, sun, Margins(1e-3, 1e-5, 1e-3)) == SAFE for x, sun in rows())


def test_each_constraint_but_passive_safety_certifies_closed_motions():
    for code in KERNELS:
        kernels = CERTIFIED[code].kernels
        by_nodes = kernels.closed_broken is not None and kernels.closed_uncertain is not None
        assert by_nodes != (kernels.amplitude is not None), NAMES[code]
    assert CERTIFIED[PSM].kernels is None


@pytest.mark.parametrize("question", ["gap", "turn", "allowed_speed"])
def test_the_bits_of_a_question_are_those_of_the_constraints_that_answer_it(question: str) -> None:
    answering = {code for code, each in enumerate(CERTIFIED) if getattr(each.kernels, question, None) is not None}
    assert answering
    assert {code for code in range(len(CERTIFIED)) if bits_of(question) & (1 << code)} == answering
    assert bits_of(question) < 1 << len(CERTIFIED)
