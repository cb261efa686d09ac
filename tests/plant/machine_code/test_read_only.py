"""One specialisation serves arrays that may be written and those that may only be read."""

from typing import Any

import numba
import numpy as np
import pytest

from flexslew_plant.arrays import Matrix, Vector, compiled_once, merged


def specialisations(function: Any) -> int:
    """Return of how many kinds of arguments there is machine code."""
    return len(function.signatures)


def test_both_kinds_of_arrays_meet_one_specialisation() -> None:
    @compiled_once("out")
    def scaled(x: Vector, factor: float, out: Vector) -> None:
        for k in range(x.size):
            out[k] = factor * x[k]

    out, free, kept = np.empty(2), np.ones(2), np.ones(2)
    kept.flags.writeable = False
    for x in (free, kept, free):
        scaled(x, 3.0, out)
        np.testing.assert_array_equal(out, [3.0, 3.0])
    assert specialisations(scaled) == 1


def test_no_call_asks_the_compiler_again(monkeypatch: pytest.MonkeyPatch) -> None:
    @compiled_once("out")
    def summed(x: Vector, y: Vector, out: Vector) -> None:
        out[0] = x[0] + y[0]

    out, free, kept = np.empty(1), np.ones(2), np.ones(2)
    kept.flags.writeable = False
    pairs = [(x, y) for x in (free, kept) for y in (free, kept)]
    for x, y in pairs:
        summed(x, y, out)
    asked: list[object] = []
    monkeypatch.setattr(summed, "compile", asked.append)
    for x, y in pairs:
        summed(x, y, out)
    assert asked == []


def test_machine_code_that_writes_into_what_it_only_reads_does_not_compile() -> None:
    @compiled_once()
    def wrong(x: Vector) -> None:
        x[0] = 1.0

    with pytest.raises(numba.TypingError, match="readonly"):
        wrong(np.zeros(2))


def test_what_is_called_from_other_machine_code_is_compiled_once_as_well() -> None:
    @compiled_once()
    def inner(x: Vector) -> float:
        return float(x[0] + x[1])

    @compiled_once("out")
    def outer(x: Vector, out: Vector) -> None:
        own = x.copy()
        out[0] = inner(own) + inner(x)

    out, kept = np.empty(1), np.ones(2)
    kept.flags.writeable = False
    outer(kept, out)
    assert out[0] == 4.0
    assert inner(np.ones(2)) == 2.0
    assert specialisations(inner) == 1


def test_compiled_callers_leave_calls_from_python_to_the_dispatcher(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An overload that each caller told it again would match twice: the compiler is asked."""

    @compiled_once()
    def inner(x: Vector) -> float:
        return float(x[0])

    def caller(sign: float) -> Any:
        return numba.njit(lambda x: sign * inner(x))

    free = np.ones(2)
    assert [caller(sign)(free) for sign in (1.0, -1.0, 2.0)] == [1.0, -1.0, 2.0]
    asked: list[object] = []
    monkeypatch.setattr(inner, "compile", asked.append)
    assert inner(free) == 1.0
    assert asked == []


def test_what_is_merged_is_compiled_once_for_whole_matrices_and_for_parts_of_them() -> None:
    @merged("out")
    def trace(x: Matrix, out: Vector) -> None:
        for k in range(out.size):
            out[k] = x[k, k]

    @numba.njit  # type: ignore[untyped-decorator]
    def outer(x: Matrix) -> Vector:
        whole, part = np.empty(2), np.empty(2)
        trace(x, whole)
        trace(x.copy()[:, 1:], part)
        return whole + part

    kept = np.arange(6.0).reshape(2, 3)
    kept.flags.writeable = False
    np.testing.assert_array_equal(outer(kept), [0.0 + 1.0, 4.0 + 5.0])
    assert specialisations(trace) == 1
