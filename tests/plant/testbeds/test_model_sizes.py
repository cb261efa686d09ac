"""Machine code reads without looking: what hands it arrays refuses those that do not fit."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from flexslew_plant.testbeds import TESTBEDS, Model

DOORS: dict[str, Callable[[Model, Any, Any, Any, Any], object]] = {
    "advance": lambda model, q, v, x, u: model.advance(x, u, 0.01),
    "derivative": lambda model, q, v, x, u: model.derivative(x, u),
    "jacobian": lambda model, q, v, x, u: model.jacobian(x, u),
    "energy": lambda model, q, v, x, u: model.energy(x),
    "bias": lambda model, q, v, x, u: model.bias(q, v),
    "mass_matrix": lambda model, q, v, x, u: model.mass_matrix(q),
    "linearise": lambda model, q, v, x, u: model.linearise(q),
    "residual_slopes": lambda model, q, v, x, u: model.residual_slopes(x, v),
    "position_rates": lambda model, q, v, x, u: model.position_rates(q),
}
TAKES = {"advance": "xu", "derivative": "xu", "jacobian": "xu", "energy": "x", "bias": "qv",
         "mass_matrix": "q", "linearise": "q", "residual_slopes": "xv",
         "position_rates": "q"}  # fmt: skip


@pytest.fixture(scope="module", params=["csa", "spacecraft"])
def model(request: pytest.FixtureRequest) -> Model:
    built: Model = TESTBEDS[request.param].settings().model()
    return built


@pytest.mark.parametrize("door", DOORS)
def test_a_wrong_length_is_refused_with_the_shape_that_fits(model: Model, door: str) -> None:
    right = {"q": model.positions, "v": model.coordinates, "u": model.efforts}
    right["x"] = right["q"] + right["v"]
    for name in TAKES[door]:
        words = f"({model.state_names[-1]}|one per (actuator|coordinate))"
        for size in (0, right[name] - 1, right[name] + 1):
            sizes = {**right, name: size}
            given = [np.zeros(sizes[key]) for key in "qvxu"]
            with pytest.raises(ValueError, match=rf"fit: \({right[name]},\).*{words}"):
                DOORS[door](model, *given)


def test_a_list_is_refused_and_whole_numbers_are_not_rounded(model: Model) -> None:
    x, u = np.zeros(model.positions + model.coordinates), np.ones(model.efforts)
    wrong: Any = x.tolist()
    with pytest.raises(ValueError, match="a state of shape a list does not fit"):
        model.advance(wrong, u, 0.01)
    whole: Any = x.astype(np.int64)
    after = model.advance(whole, u, 0.01)
    assert np.array_equal(after, model.advance(x, u, 0.01))
    assert after.any()
