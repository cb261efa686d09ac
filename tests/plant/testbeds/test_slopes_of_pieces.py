"""The derivatives of a step of every kind of testbed against differences of that step."""

from typing import Any

import numpy as np
import pytest

from flexslew_plant.testbeds import WITH_EQUATIONS, read_testbed

PIECES, DURATION = 3, 0.15  # [s]
# five points for a difference of order four: what remains is their rounding, some 1e-12 / 1e-3
CHANGE = 1e-3
WEIGHTS = ((2.0, -1.0 / 12.0), (1.0, 2.0 / 3.0), (-1.0, -2.0 / 3.0), (-2.0, 1.0 / 12.0))
CRAFT = {
    "kind": "spacecraft",
    "platform": {"mass": 150.0, "inertia": {"xx": 40.0, "yy": 60.0, "zz": 50.0, "xy": 3.0}},
    "appendages": {
        "boom": {
            "hinge": {"kind": "driven", "place": [0.0, 0.5, 0.0], "axis": [0.0, 0.0, 1.0]},
            "shape": {"kind": "beam", "length": 3.0, "linear_density": 0.6,
                      "bending_stiffness": 60.0, "modes": 2, "along": [0.0, 1.0, 0.0]},
            "damping": {"ratio": 0.01},
        }
    },
    "wheels": {"wheel": {"axis": [0.0, 0.6, 0.8], "inertia": 0.02, "limit": 0.5}},
    "actuators": {"push": {"kind": "force", "direction": [0.0, 0.0, 1.0], "limit": 1.0,
                           "place": [0.3, 0.0, 0.0]},
                  "aside": {"kind": "force", "direction": [1.0, 0.0, 0.0], "limit": 1.0,
                            "appendage": "boom"}},  # whose B turns with the hinge, and bends
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*sorted(WITH_EQUATIONS), "craft"])
def test_the_slopes_of_pieces_are_those_of_advance(kind: str) -> None:
    values: Any = CRAFT if kind == "craft" else {"kind": kind}
    model = read_testbed(values, "here").model()
    rng = np.random.default_rng(len(kind))
    start = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    start[model.positions :] += 0.05 * rng.standard_normal(model.coordinates)
    effort = 0.3 * rng.standard_normal((PIECES, model.efforts))
    durations, steps = DURATION * np.array([1.0, 0.3, 2.0]), np.array([1, 1, 2])
    begins, states = np.cumsum(durations) - durations, [start]
    for t, u, h, count in zip(begins, effort, durations, steps, strict=True):
        states.append(model.advance(states[-1], u, h, int(count), t))
    by_state, by_effort = model.slopes_of_pieces(np.array(states[:-1]), effort, durations, steps)
    for k in range(PIECES):
        dx, du = rng.standard_normal(start.size), rng.standard_normal(model.efforts)
        expected = np.zeros(start.size)
        for share, weight in WEIGHTS:
            x, u = states[k] + share * CHANGE * dx, effort[k] + share * CHANGE * du
            after = model.advance(x, u, durations[k], int(steps[k]), begins[k])
            expected += weight / CHANGE * after
        found = by_state[k] @ dx + by_effort[k] @ du
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-8 * abs(expected).max())


def test_only_the_columns_that_are_asked_for_are_found() -> None:
    model = read_testbed(CRAFT, "here").model()
    start = np.concatenate((model.rest({}), np.full(model.coordinates, 0.02)))
    given = start[None], np.zeros((1, model.efforts)), np.array([0.1]), np.array([1])
    which = np.array([3, 5, 9])
    whole, part = (model.slopes_of_pieces(*given, columns=c)[0] for c in (None, which))
    np.testing.assert_array_equal(part[:, :, which], whole[:, :, which])
    assert not np.delete(part, which, axis=2).any()
