"""Machine code of the bench rounds every product, whatever it was compiled for first."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flexslew_plant.arrays import called, compiled, compiled_once, inline, merged, vectorised

# x y + z is 0 where the product is rounded, and -2^-60 where it is fused with the sum
X, Y, Z = 1.0 + 2.0**-30, 1.0 - 2.0**-30, -1.0


def written(out: Any, x: float, y: float, z: float) -> None:
    out[0] = x * y + z


def fused_somewhere() -> bool:
    """Return whether this processor fuses what it may fuse."""
    fused: Any = vectorised(lambda x, y, z: x * y + z)
    return bool(fused(X, Y, Z) != 0.0)


@pytest.mark.parametrize("decorate", [compiled, called, inline])
def test_a_value_is_rounded_where_a_vectorised_loop_wanted_it_first(
    decorate: Callable[..., Any],
) -> None:
    if not fused_somewhere():
        pytest.skip("this processor fuses no products with sums")
    strict: Any = decorate(lambda x, y, z: x * y + z)
    loop: Any = vectorised(lambda x, y, z: strict(x, y, z))
    loop(X, Y, Z)
    assert strict(X, Y, Z) == 0.0


@pytest.mark.parametrize("decorate", [compiled_once("out"), merged("out")])
def test_what_is_written_is_rounded_where_a_vectorised_loop_wanted_it_first(
    decorate: Callable[..., Any],
) -> None:
    if not fused_somewhere():
        pytest.skip("this processor fuses no products with sums")
    strict: Any = decorate(written)
    out = np.ones(1)
    loop: Any = vectorised(lambda out, x, y, z: strict(out, x, y, z))
    loop(out, X, Y, Z)
    strict(out, X, Y, Z)
    assert out[0] == 0.0
