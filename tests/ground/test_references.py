"""A large named tuple is handed to a kernel by its address, and reads as it does in Python."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof
from numba.core.errors import TypingError

from safe_inspect.compiling import njit
from safe_inspect.compiling.references import TupleReference, handed
from safe_inspect.types import FloatArray, IntArray


class Inner(NamedTuple):
    weights: FloatArray
    cube: FloatArray
    pair: tuple[float, float]
    whole: IntArray


class Outer(NamedTuple):
    scale: float
    on: bool
    one: Inner
    other: Inner
    steps: int


@njit(error_model="numpy")
def weighed(inner: Inner, row: int) -> float:
    total = inner.pair[0] - inner.pair[1]
    for k in range(inner.weights.shape[0]):
        total += inner.weights[k] * inner.cube[row, k, 0]
    inner.whole[row] += 1
    return total


@njit(error_model="numpy")
def chosen(outer: Outer, row: int) -> float:
    inner = outer.one if row % 2 == 0 else outer.other
    return outer.scale * weighed(inner, row) + outer.steps if outer.on else 0.0


@njit(error_model="numpy")
def summed(outer: Outer, out: FloatArray) -> None:
    for row in range(out.shape[0]):
        turned = Outer(-outer.scale, row > 0, outer.other, outer.one, row)
        out[row] = chosen(outer, row) + 10.0 * chosen(turned, row)


@njit(error_model="numpy")
def in_turn(first: Outer, rows: int, out: FloatArray) -> None:
    """Hand on a tuple whose variable has another value by then."""
    now = first
    for row in range(rows):
        before = now
        now = Outer(now.scale + 1.0, True, now.other, now.one, row)
        out[row] = chosen(before, row) - 10.0 * chosen(now, row)


@njit(error_model="numpy")
def under_another_name(given: Outer, rows: int, out: FloatArray) -> None:
    """Hand on a tuple whose first name is not used any more."""
    made = Outer(given.scale + 1.0, given.on, given.one, given.other, rows)
    for row in range(rows):
        out[row] = 0.0
    if rows > 0:
        kept = made
        out[0] = chosen(kept, 0)


@njit
def same(outer: Outer) -> Outer:
    return outer


@njit
def handing_back(outer: Outer) -> float:
    return same(outer).scale


def outer() -> Outer:
    draws = np.random.default_rng(3)
    one, other = (Inner(draws.random(4), draws.random((5, 4, 2)), (1.5, k), np.zeros(5, np.int64)) for k in (0.25, 4.0))
    return Outer(0.5, True, one, other, 7)


def in_python(outer: Outer, row: int) -> float:
    if not outer.on:
        return 0.0
    inner = outer.other if row % 2 else outer.one
    total = inner.pair[0] - inner.pair[1]
    for k in range(4):
        total += inner.weights[k] * inner.cube[row, k, 0]
    inner.whole[row] += 1
    return float(outer.scale * total + outer.steps)


def test_a_large_tuple_is_read_as_in_python() -> None:
    got, given, expected = np.empty(5), outer(), outer()
    summed(given, got)
    for row in range(5):
        turned = Outer(-expected.scale, row > 0, expected.other, expected.one, row)
        assert got[row] == in_python(expected, row) + 10.0 * in_python(turned, row), row
    assert given.one.whole.tolist() == expected.one.whole.tolist()
    assert given.other.whole.tolist() == expected.other.whole.tolist()
    assert isinstance(handed(typeof(given)), TupleReference)


def test_a_tuple_is_the_one_that_its_name_stood_for() -> None:
    got, expected = np.empty(5), outer()
    in_turn(outer(), 5, got)
    now = expected
    for row in range(5):
        before, now = now, Outer(now.scale + 1.0, True, now.other, now.one, row)
        assert got[row] == in_python(before, row) - 10.0 * in_python(now, row), row


def test_a_tuple_holds_when_its_first_name_is_not_used_any_more() -> None:
    got, given = np.empty(2), outer()
    under_another_name(outer(), 2, got)
    assert got.tolist() == [in_python(given._replace(scale=1.5, steps=2), 0), 0.0]


def test_a_kernel_does_not_return_the_address_of_a_tuple() -> None:
    with pytest.raises(TypingError, match="same returns a tuple that it is given; return what is needed of it"):
        handing_back(outer())
