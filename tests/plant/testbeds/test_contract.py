"""Every testbed of the table, and one of a user's own, keeps the contract."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import (
    WITH_EQUATIONS,
    design_testbed,
    initial_positions,
    initial_state,
    read_testbed,
    with_changes,
)
from flexslew_plant.testbeds.scene import schematic

OWN = f"{Path(__file__).parents[3] / 'docs/examples/three_joints.py'}:ThreeJoints"
KINDS = [*WITH_EQUATIONS, OWN]
# factors on the packed parameters that take the dependence on time away
FROZEN = {"varying_oscillator": np.array([1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0])}
# q is as long as v; a free platform turns by quaternions, see spacecraft/test_jacobian.py
LONG_AS_V = [
    kind for kind in KINDS if read_testbed({"kind": kind}, "here", ANY_CODE).model().leading is None
]
every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.rpartition(":")[2])
same_lengths = pytest.mark.parametrize("kind", LONG_AS_V, ids=lambda kind: kind.rpartition(":")[2])


def bed(kind: Any, **more: Any) -> Any:
    return read_testbed({"kind": kind, **more}, "here", ANY_CODE)


def damped(kind: Any, ratio: float) -> Any:
    """Return a testbed whose modes are damped, with the keys that its entry gives as an example."""
    given = WITH_EQUATIONS[kind].example if kind in WITH_EQUATIONS else {}
    return bed(kind, **(given or {"damping_ratio": ratio}))


def states(model: Any, count: int = 5, size: float = 0.2) -> Iterator[Any]:
    rng = np.random.default_rng(7)
    for _ in range(count):
        joints = dict(zip(model.joint_names, size * rng.standard_normal(model.joints), strict=True))
        q = model.rest(joints)
        q[model.positions - model.modes :] = size * rng.standard_normal(model.modes)
        v = size * rng.standard_normal(model.coordinates)
        yield np.concatenate((q, v)), rng.standard_normal(model.efforts)


@every_kind
def test_names_units_and_limits_belong_together(kind: Any) -> None:
    testbed = bed(kind)
    model = testbed.model()
    assert len(set(model.joint_names)) == len(model.joint_units) == model.joints
    assert len(testbed.effort_limit) == model.efforts
    assert all(limit > 0.0 for limit in testbed.effort_limit)
    assert set(initial_positions(testbed)) == set(model.joint_names)
    assert set(testbed.typical_goal) <= set(model.joint_names)
    assert set(testbed.operating_point) <= set(model.joint_names)
    assert model.appendages.tip.shape == (len(model.appendages.names), testbed.modes)
    assert model.appendages.curvature.shape == model.appendages.tip.shape


@every_kind
def test_a_section_survives_being_written_out(kind: Any) -> None:
    testbed = damped(kind, 0.02)
    assert read_testbed(plain(testbed), "again", ANY_CODE) == testbed


@every_kind
def test_the_mass_matrix_is_symmetric_and_positive_and_the_motion_solves_the_equations(
    kind: Any,
) -> None:
    model = bed(kind).model()
    for x, effort in states(model):
        q, v = model.split(x)
        mass = model.mass_matrix(q)
        np.testing.assert_allclose(mass, mass.T, atol=1e-13 * abs(mass).max())
        assert np.linalg.eigvalsh(mass).min() > 0.0
        a = model.derivative(x, effort)[model.positions :]
        force = model.input_matrix(q) @ effort
        np.testing.assert_allclose(mass @ a + model.bias(q, v), force, atol=1e-11 * abs(mass).max())


@same_lengths
def test_the_jacobian_is_that_of_the_motion(kind: Any) -> None:
    model = damped(kind, 0.03).model()
    for x, effort in states(model):
        dx, du = model.jacobian(x, effort)
        for found, change in ((dx, 0), (du, 1)):
            columns = []
            for unit in np.eye(effort.size if change else x.size):
                h = 1e-6 * unit
                ahead = model.derivative(x + (0 if change else h), effort + (h if change else 0))
                behind = model.derivative(x - (0 if change else h), effort - (h if change else 0))
                columns.append((ahead - behind) / 2e-6)
            np.testing.assert_allclose(found, np.array(columns).T, atol=2e-7 * abs(found).max())


def drifted(model: Any, x: Any) -> Any:
    """Return the state after 5 s without effort."""
    still = np.zeros(model.efforts)
    found = solve_ivp(
        lambda t, y: model.derivative(y, still), (0.0, 5.0), x, "DOP853", rtol=1e-12, atol=1e-13
    )
    return found.y[:, -1]


@every_kind
def test_energy_changes_by_the_power_of_the_efforts_alone(kind: Any) -> None:
    model = bed(kind).model()
    if model.time_varying:
        model = replace(model, packed=model.packed * FROZEN[kind])
    for x, effort in states(model, 3):
        free = drifted(model, x)
        assert model.energy(free) == pytest.approx(model.energy(x), rel=1e-9, abs=1e-9)
        rate = model.derivative(x, effort)
        gained = (model.energy(x + 1e-6 * rate) - model.energy(x - 1e-6 * rate)) / 2e-6
        power = model.split(x)[1] @ model.input_matrix(model.split(x)[0]) @ effort
        assert gained == pytest.approx(power, rel=1e-6, abs=1e-8 * (1.0 + abs(model.energy(x))))


@every_kind
def test_the_linear_model_is_the_derivative_at_rest(kind: Any) -> None:
    testbed = damped(kind, 0.01)
    model = testbed.model()
    rest = model.rest(testbed.operating_point)
    linear = model.linearise(rest)
    x = np.concatenate((rest, np.zeros(model.coordinates)))
    dx, du = model.jacobian(x, np.zeros(model.efforts))
    np.testing.assert_allclose(linear.state_matrix, dx, atol=1e-9 * abs(dx).max())
    np.testing.assert_allclose(linear.state_input_matrix, du, atol=1e-12)


@every_kind
def test_joints_are_read_of_many_states_as_of_one(kind: Any) -> None:
    model = bed(kind).model()
    rows = np.array([x for x, _ in states(model)])
    alone = zip(*map(model.joint_state, rows), strict=True)
    for found, expected in zip(model.joint_states(rows), alone, strict=True):
        np.testing.assert_array_equal(found, expected)


@every_kind
def test_a_path_is_one_hold_after_the_other(kind: Any) -> None:
    model = damped(kind, 0.02).model()
    (x, effort), *_ = states(model)
    efforts = effort * np.array([[1.0], [-0.5], [0.0]])
    found = model.path(x, efforts, 0.02, 2, 1.5)
    for k, (held, after) in enumerate(zip(efforts, found, strict=True)):
        x = model.advance(x, held, 0.02, 2, 1.5 + k * 0.02)
        np.testing.assert_array_equal(after, x)


@same_lengths
def test_stiffness_scales_the_squares_of_the_clamped_frequencies(kind: Any) -> None:
    testbed = damped(kind, 0.02)
    stiffer = testbed.scaled(stiffness=1.21).model()
    np.testing.assert_allclose(
        testbed.model().with_stiffness(1.21).packed, stiffer.packed, rtol=1e-12
    )
    m = stiffer.joints
    for model, factor in ((testbed.model(), 1.0), (stiffer, 1.21)):
        linear = model.linearise(model.rest({}))
        squares = np.diag(linear.stiffness)[m:] / np.diag(linear.mass)[m:]
        if factor == 1.0:
            nominal = squares
        np.testing.assert_allclose(squares, factor * nominal, rtol=1e-12)
    assert testbed.scaled() == testbed


@every_kind
def test_a_planner_believes_in_the_testbed_but_for_what_is_simplified(kind: Any) -> None:
    testbed = damped(kind, 0.02)
    seen = design_testbed(testbed, None, "plan")
    assert seen == with_changes(testbed, testbed.simplified, "plan")
    assert getattr(seen, "damping_ratio", 0.02) == 0.02
    assert seen.model().joint_names == testbed.model().joint_names
    with pytest.raises(BadInput, match=r"plan.*modez: unknown key"):
        design_testbed(testbed, {"modez": 1}, "plan")


@every_kind
def test_it_can_be_drawn_at_rest_and_bent(kind: Any) -> None:
    testbed = bed(kind)
    scene, q = testbed.scene(), testbed.model().split(initial_state(testbed))[0]
    straight, frames = scene.lines(q), {frame.child for frame in scene.frames(q)}
    assert set(scene.line_frames) <= frames
    assert len(straight) == len(scene.line_frames)
    bent = scene.lines(q + 0.1)
    assert all(not np.allclose(a, b) for a, b in zip(straight, bent, strict=True))


def test_three_decoupled_joints_move_as_three_bodies() -> None:
    """The elimination is right for any number of joints, not only for one and two."""
    model = bed(OWN, inertias=[40.0, 20.0, 15.0]).model()
    effort = np.array([3.0, 2.0, 1.0])
    a = model.derivative(np.zeros(2 * model.coordinates), effort)[model.coordinates :]
    mass = model.mass_matrix(np.zeros(model.coordinates))
    np.testing.assert_allclose(a, np.linalg.solve(mass, np.append(effort, [0.0, 0.0])), rtol=1e-12)


def test_a_schematic_draws_any_testbed() -> None:
    scene = schematic("mine", ("a", "b", "c"), ("left", "right"), np.array([[1.0], [-1.0]]))
    q = np.array([0.1, 0.2, 0.3, 0.05])
    assert [frame.child for frame in scene.frames(q)] == ["a_link", "b_link", "c_link"]
    left, right = scene.lines(q)
    np.testing.assert_allclose(left[-1], [2.3, 0.05, 0.0], atol=1e-12)
    np.testing.assert_allclose(right[-1], [-2.3, 0.05, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("moon", "moon is not a testbed; allowed: csa"),
        ("nowhere.py:Bed", "nowhere.py:Bed cannot be loaded: .*No such file"),
        (OWN.replace("ThreeJoints", "JOINTS"), "is a tuple; a class is needed"),
        ("no_such_package.Bed", "cannot be loaded: ModuleNotFoundError"),
    ],
)
def test_a_kind_that_is_not_there_is_refused_in_one_line(kind: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        bed(kind)
    assert "\n" not in str(caught.value)


def test_a_wrong_key_of_ones_own_testbed_is_named() -> None:
    with pytest.raises(BadInput, match=r"inertiaz: unknown key; did you mean inertias\?"):
        bed(OWN, inertiaz=[1.0, 1.0, 1.0])
