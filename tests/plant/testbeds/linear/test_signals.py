"""Signals: what is measured, sampled systems, and one line for each thing that does not fit."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from tests.linear_plants import modal_plant

from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.state_space import StateSpace
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.linear.signals import plant_of

MODES = modal_plant(
    [0.0, 2.0, 5.0], [[0.1], [0.2], [-0.1]], read=[[0.1, 0.0], [0.2, 1.0], [-0.1, -0.7]]
)


def rows(matrix: Any) -> Any:
    return tuple(map(tuple, np.asarray(matrix, dtype=float).tolist()))


SYSTEM = StateSpace(
    a=rows(MODES.a),
    b=rows(MODES.b),
    c=rows(MODES.c),
    inputs=("effort.hub",),
    outputs=("position.hub", "tip.boom"),
)
RATE_ROW = [MODES.c[0] @ MODES.a, MODES.c[1]]


def test_a_rate_alone_is_integrated_by_a_state_that_is_there_or_by_one_more() -> None:
    a, c = rows(MODES.a[1:, 1:]), rows(np.array(RATE_ROW)[:, 1:])
    by_rate = replace(SYSTEM, a=a, b=rows(MODES.b[1:]), c=c, outputs=("rate.hub", "tip.boom"))
    assert len(plant_of(by_rate).a) == 6  # five states show no place: one more does
    on_ground = modal_plant([1.0, 2.0], [[0.1], [0.2]])
    seen = StateSpace(a=rows(on_ground.a), b=rows(on_ground.b), c=rows(on_ground.c @ on_ground.a),
                      outputs=("rate.joint_1",))  # fmt: skip
    assert len(plant_of(seen).a) == 4
    model = read_testbed({"kind": "linear", "system": vars(by_rate)}, "here").model()
    exact = read_testbed({"kind": "linear", "system": vars(SYSTEM)}, "here").model()
    x, other, effort = np.zeros(2 * model.coordinates), np.zeros(6), np.array([3.0])
    for _ in range(50):
        x, other = model.advance(x, effort, 0.1), exact.advance(other, effort, 0.1)
    np.testing.assert_allclose(model.joint_state(x), exact.joint_state(other), rtol=1e-9)
    tips = [exact_readings(m, at, effort, 0.0)[2] for m, at in ((model, x), (exact, other))]
    assert tips[0] == pytest.approx(tips[1], rel=1e-9)


@pytest.mark.parametrize("period", [0.01, 0.3])
def test_a_sampled_plant_moves_as_its_samples_at_any_other_period(period: float) -> None:
    whole = expm(np.block([[MODES.a, MODES.b], [np.zeros((1, 7))]]) * period)
    sampled = replace(SYSTEM, a=rows(whole[:6, :6]), b=rows(whole[:6, 6:]), period=period)
    model = read_testbed({"kind": "linear", "system": vars(sampled)}, "here").model()
    z, x, effort = np.zeros(6), np.zeros(6), np.array([2.0])
    for _ in range(40):
        z = whole[:6, :6] @ z + whole[:6, 6] * 2.0
        x = model.advance(model.advance(x, effort, 0.5 * period), effort, 0.5 * period)
    read = np.hstack(exact_readings(model, x, effort, 0.0)[::2])
    assert read == pytest.approx(MODES.c @ z, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"b": ((1.0,),)}, r"system\.b: give 6 rows of 1 numbers, for 6 states, 1 inputs and 2"),
        ({"a": ()}, r"system\.a: a plant has states; give A, B and C"),
        ({"a": rows(MODES.a[:, :5])}, r"system\.a: give 6 rows of 6 numbers"),
        ({"d": ((0.0,), (1.0,))}, r"system\.d: tip\.boom is set by an effort at once; .* D = 0"),
        ({"c": rows(RATE_ROW)}, r"position\.hub has a rate that an effort sets .* rate\.hub$"),
        (
            {"c": rows([MODES.c[0], *MODES.c]), "outputs": ("position.hub", "rate.hub", "tip.b")},
            r"rate\.hub is not the derivative of position\.hub, C A; leave one of them out",
        ),
        (
            {"outputs": ("position.hub", "tipp.boom")},
            r"tipp\.boom is not allowed; .*tip\.APPENDAGE",
        ),
        (
            {"outputs": ("position.hup", "tip.boom")},
            r"position\.hup is not allowed; .*position\.hub",
        ),
        (
            {"outputs": ("tip.left", "tip.boom")},
            r"no rate\.hub; a joint is measured",
        ),
        ({"outputs": ("position.hub",) * 2}, r"outputs: position\.hub is there twice"),
        ({"outputs": ("position.hub",)}, r"system\.c: give 1 rows of 6"),
        ({"outputs": (), "c": rows(np.ones((3, 6)))}, r"3 without names for 1 inputs; name them"),
        ({"inputs": ("effort.",)}, r"inputs: effort\. is not allowed: effort\.JOINT"),
        ({"inputs": ("a", "b")}, r"is measured; give position\.a|is not allowed"),
        (
            {"a": rows(np.diag([0.5, 0.5, 0.5, 0.5, 0.5, -0.2])), "period": 0.01},
            r"system\.period: no continuous plant has these samples: its pole z = -0\.2; .*Ts: 0",
        ),
        ({"a": rows(0.0 * MODES.a), "period": 0.01}, r"its pole z = 0; "),
        (
            {"c": rows([MODES.c[0], MODES.c[0] + MODES.c[1]])},
            r"tip\.boom reads the motion of a joint, too; give the deflection",
        ),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(change: Any, words: str) -> None:
    values = {"kind": "linear", "system": {**vars(SYSTEM), **change}}
    with pytest.raises(BadInput, match=words) as caught:
        read_testbed(values, "plant.yaml")
    assert "\n" not in str(caught.value)


def test_an_input_that_pushes_back_has_a_minus_before_its_name() -> None:
    turned = replace(SYSTEM, b=rows(-MODES.b), inputs=("-effort.hub",))
    wrong = vars(replace(turned, inputs=("effort.hub",)))
    with pytest.raises(BadInput, match=r"input 1 does not .* -effort\.JOINT if it pushes back"):
        read_testbed({"kind": "linear", "system": wrong}, "here")
    np.testing.assert_array_equal(plant_of(turned).b, plant_of(SYSTEM).b)


def test_a_plant_of_too_many_states_is_refused_before_anything_is_computed() -> None:
    huge = rows(np.zeros((601, 1)))
    with pytest.raises(BadInput, match="601 states; at most 600 fly: reduce the model"):
        plant_of(StateSpace(a=huge, b=huge, c=((0.0,) * 601,)))
