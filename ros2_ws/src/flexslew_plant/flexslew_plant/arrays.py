"""Names for the arrays that pass through the public interface."""

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from flexslew_plant.machine_code.cache_names import set_cache_name
from flexslew_plant.machine_code.compile_lock import one_at_a_time
from flexslew_plant.machine_code.processor import configure_compiler
from flexslew_plant.machine_code.read_only import for_all_access

Vector: TypeAlias = NDArray[np.float64]  # one index
Matrix: TypeAlias = NDArray[np.float64]  # two indices
Tensor: TypeAlias = NDArray[np.float64]  # three indices
Indices: TypeAlias = NDArray[np.int64]  # which entries of a vector

EMPTY: Vector = np.zeros(0)  # of what has no numbers
EMPTY.flags.writeable = False

configure_compiler()

# An option that a function does not set comes from its first compiled caller: if that one is
# `vectorised`, the products would be fused with sums from then on, on disk, too.
_STRICT: dict[str, Any] = {"error_model": "numpy", "fastmath": False}

Number = TypeVar("Number", float, Vector)  # of one joint, or of all: a step takes either
_Function = TypeVar("_Function", bound=Callable[..., Any])
_Array = TypeVar("_Array", bound=NDArray[Any])


def read_only(array: _Array) -> _Array:
    """Return an array after making it one that may only be read; its maker writes no more."""
    # a third of the time of flags.writeable = False, half of that of a keyword
    array.setflags(False)  # type: ignore[call-arg]
    return array


def keep_all(arrays: Iterable[NDArray[Any]]) -> None:
    """Make arrays such that may only be read, see kept."""
    for array in arrays:
        array.setflags(False)  # type: ignore[call-arg]


def read_only_view(array: _Array) -> _Array:
    """Return an array through which its owner's may only be read."""
    return read_only(array.view()) if array.flags.writeable else array


def compiled(function: _Function) -> _Function:
    """Return function as machine code, kept on disk between runs.

    Floating point stays strictly IEEE (no fastmath, no contraction across runs), so the same
    inputs give the same bits in every process of one machine.
    """
    kept = numba.njit(cache=True, **_STRICT)(function)
    return cast(_Function, one_at_a_time(set_cache_name(kept)))


def compiled_once(*written: str) -> Callable[[_Function], _Function]:
    """Return what makes machine code that a run calls: see compiled.

    One specialisation serves arrays that may be written and those that may not (what a bench hands
    out), so that a run meets no other one than a warm-up did.

    Args:
        written: arguments that the function writes into; all other arrays it only reads.
    """

    def made(function: _Function) -> _Function:
        kept = set_cache_name(numba.njit(cache=True, **_STRICT)(function))
        return cast(_Function, for_all_access(one_at_a_time(kept), written))

    return made


def inline(function: _Function) -> _Function:
    """Return function for use inside compiled ones, where its body replaces the call."""
    return cast(_Function, set_cache_name(numba.njit(inline="always", **_STRICT)(function)))


MERGED = {"forceinline": True, **_STRICT}  # Numba options of `merged`


def merged(*written: str, strided: bool = True) -> Callable[[_Function], _Function]:
    """Return a decorator of functions for use inside compiled ones, merged as machine code.

    It compiles a function once for all callers; `inlined` would compile its body for each of them.
    One specialisation serves arrays that may be written and those that may not.

    Args:
        written: arguments that the function writes into; all other arrays it only reads.
        strided: whether it serves whole matrices and parts of wider ones, too.
    """

    def made(function: _Function) -> _Function:
        kept = set_cache_name(numba.njit(**MERGED)(function))
        return cast(_Function, for_all_access(kept, written, strided))

    return made


def called(function: _Function) -> _Function:
    """Return function for calls from compiled ones; the compiler may merge the two.

    For what is called from many places: `inlined` would compile its body for each of them.
    """
    return cast(_Function, set_cache_name(numba.njit(**_STRICT)(function)))


@called
def put(values: Vector, out: Vector) -> None:
    """Write values into compiled code's own array: out[:] = values compiles words about shapes."""
    for k in range(out.size):
        out[k] = values[k]


def vectorised(function: _Function) -> _Function:
    """Return function as machine code for loops over members, kept on disk between runs.

    A product may be fused with the sum that it goes into, which the processor rounds once; every
    member is still computed alike, wherever it stands.
    """
    options = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}
    return cast(_Function, one_at_a_time(set_cache_name(numba.njit(**options)(function))))
