"""Names for the arrays that pass through the public interface."""

from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from flexslew_plant.cache_names import recognised
from flexslew_plant.compile_lock import one_at_a_time

Vector: TypeAlias = NDArray[np.float64]  # one index
Matrix: TypeAlias = NDArray[np.float64]  # two indices
Tensor: TypeAlias = NDArray[np.float64]  # three indices

_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(function: _Function) -> _Function:
    """Return function as machine code, kept on disk between runs.

    Floating point stays strictly IEEE (no fastmath, no contraction across runs), so the same
    inputs give the same bits in every process of one machine.
    """
    kept = numba.njit(cache=True, error_model="numpy")(function)
    return cast(_Function, one_at_a_time(recognised(kept)))


def inlined(function: _Function) -> _Function:
    """Return function for use inside compiled ones, where its body replaces the call."""
    return cast(_Function, recognised(numba.njit(inline="always", error_model="numpy")(function)))


def called(function: _Function) -> _Function:
    """Return function for calls from compiled ones; the compiler may merge the two.

    For what is called from many places: `inlined` would compile its body for each of them.
    """
    return cast(_Function, recognised(numba.njit(error_model="numpy")(function)))


def vectorised(function: _Function) -> _Function:
    """Return function as machine code for loops over lanes, kept on disk between runs.

    A product may be fused with the sum that it goes into, which the processor rounds once; every
    lane is still computed alike, wherever it stands.
    """
    options = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}
    return cast(_Function, one_at_a_time(recognised(numba.njit(**options)(function))))
