"""Damping by alpha M + beta K, and ratios besides, of a spacecraft that is stiffer."""

from typing import Any

import numpy as np
import pytest

from flexslew_plant.testbeds import read_testbed

BOOM = {
    "kind": "beam",
    "length": 5.0,
    "linear_density": 0.3,
    "bending_stiffness": 200.0,
    "modes": 2,
}


@pytest.mark.parametrize(
    "damping",
    [{"alpha": 0.1}, {"beta": 0.01}, {"alpha": 0.1, "beta": 0.01, "ratio": [0.02, 0.05]}],
    ids=str,
)
def test_planners_believe_of_a_stiffer_craft_what_stands_on_the_bench(damping: Any) -> None:
    boom = {"shape": BOOM, "damping": damping}
    craft: Any = read_testbed({"kind": "spacecraft", "appendages": {"boom": boom}}, "here")
    stiffer = craft.scaled(stiffness=1.44).model()
    # alpha does not grow with the stiffness, beta's share as K, ratios as its root
    np.testing.assert_allclose(
        craft.model().with_stiffness(1.44).packed, stiffer.packed, rtol=1e-12, atol=1e-15
    )
