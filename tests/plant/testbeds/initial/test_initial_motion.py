"""Rates and deflections at the start: what is requested is what the testbed begins with."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import WITH_EQUATIONS, initial_state, read_testbed, starts_in_motion

WHEELS = {
    "a": {"axis": [1.0, 0.0, 0.0], "inertia": 0.1, "limit": 1.0, "speed_limit": 100.0},
    "b": {"axis": [0.0, 1.0, 0.0], "inertia": 0.1, "limit": 1.0},
    "c": {"axis": [0.0, 0.0, 1.0], "inertia": 0.1, "limit": 1.0},
    "d": {"axis": [0.6, 0.0, 0.8], "inertia": 0.1, "limit": 1.0},
}
GYRO = {"axis": [1.0, 0.0, 0.0], "rotor": [0.0, 1.0, 0.0], "momentum": 5.0}
LENGTH, STIFFNESS = 10.0, 500.0  # of the boom [m], [N m^2]
BOOM = {
    "hinge": {"place": [0.0, 0.0, 1.0]},
    "shape": {
        "kind": "beam",
        "length": LENGTH,
        "linear_density": 0.5,
        "bending_stiffness": STIFFNESS,
        "modes": 8,
    },
    "damping": {"ratio": 0.02},
}


def spacecraft(motion: dict[str, Any], **more: Any) -> Any:
    body = {"mass": 10.0, "inertia": {"xx": 1.0, "yy": 2.0, "zz": 3.0}}
    values = {"kind": "spacecraft", "platform": body, "initial_motion": motion, **more}
    return read_testbed(values, "here")


def start_of(testbed: Any) -> tuple[Any, Any]:
    q, v = testbed.model().split(initial_state(testbed))
    return q, v


@pytest.mark.parametrize("kind", WITH_EQUATIONS)
def test_every_joint_starts_with_its_rate(kind: str) -> None:
    names = read_testbed({"kind": kind}, "here").model().joint_names
    rates = {name: 0.1 * (k + 1) for k, name in enumerate(names)}
    testbed = read_testbed({"kind": kind, "initial_motion": {"rates": rates}}, "here")
    _, found = testbed.model().joint_state(initial_state(testbed))
    assert dict(zip(names, found, strict=True)) == pytest.approx(rates)
    assert starts_in_motion(testbed)


@pytest.mark.parametrize("kind", WITH_EQUATIONS)
def test_without_motion_nothing_changes(kind: str) -> None:
    plain = read_testbed({"kind": kind}, "here")
    empty = read_testbed({"kind": kind, "initial_motion": {}}, "here")
    assert initial_state(plain).tobytes() == initial_state(empty).tobytes()
    assert not starts_in_motion(empty)


def test_axes_that_are_not_at_right_angles_share_one_body_rate() -> None:
    testbed = spacecraft(
        {"rates": {"a": 0.1, "d": 0.3}, "wheel_speeds": {"b": 40.0}}, wheels=WHEELS
    )
    _, v = start_of(testbed)
    rate, wheels = v[3:6], v[6:10]
    assert [rate[0], rate @ WHEELS["d"]["axis"], rate[1]] == pytest.approx([0.1, 0.3, 0.0])
    assert wheels.tolist() == [0.0, 40.0, 0.0, 0.0]


def test_units_of_data_sheets_are_converted() -> None:
    _, v = start_of(
        spacecraft(
            {
                "body_rate": ["1 deg/s", 0.0, "3 rpm"],
                "velocity": ["2 cm/s", 0.0, 0.0],
                "wheel_speeds": {"b": "60 rpm"},
            },
            wheels=WHEELS,
        )
    )
    assert v[:6] == pytest.approx([0.02, 0.0, 0.0, np.pi / 180.0, 0.0, np.pi / 10.0])
    assert v[7] == pytest.approx(2.0 * np.pi)


def test_a_gimbal_angle_is_no_motion() -> None:
    craft = spacecraft({"gimbal_angles": {"one": 0.3}}, control_moment_gyros={"one": GYRO})
    assert start_of(craft)[1][6] == 0.3
    assert not starts_in_motion(craft)


def test_a_plucked_boom_bends_as_a_cantilever() -> None:
    """Under F at its tip, w = F L^3 / (3 E I); eight modes of each plane leave 1e-4 of it."""
    testbed = spacecraft({"plucked": {"boom_x": 2.0}}, appendages={"boom": BOOM})
    model = testbed.model()
    q = model.split(initial_state(testbed))[0][model.positions - model.modes :]
    tips = dict(zip(model.appendages.names, model.appendages.tip @ q, strict=True))
    assert tips["boom_x"] == pytest.approx(2.0 * LENGTH**3 / (3.0 * STIFFNESS), rel=1e-3)
    assert tips["boom_y"] == pytest.approx(0.0, abs=1e-12)


def test_a_plucked_boom_on_a_held_platform_rings_down() -> None:
    """Each mode decays alone: q = q0 e^(-s t) (cos w t + s/w sin w t), s = zeta w0."""
    held = {"motion": "held", "mass": 10.0, "inertia": {"xx": 1.0, "yy": 2.0, "zz": 3.0}}
    place = {"kind": "modal", "appendage": "boom", "mode": 1, "limit": 1.0}
    values = {
        "kind": "spacecraft",
        "platform": held,
        "appendages": {"boom": BOOM},
        "actuators": {"push": place},
        "initial_motion": {"plucked": {"boom_x": 2.0}},
    }
    model = read_testbed(values, "here").model()
    x = initial_state(read_testbed(values, "here"))
    frequency = np.sqrt(np.diag(model.linearise(model.rest({})).stiffness))
    decay, damped = 0.02 * frequency, frequency * np.sqrt(1.0 - 0.02**2)
    t = 7.0
    after = model.split(model.path(x, np.zeros((700, 1)), t / 700, 8)[-1])[0]
    wave = np.cos(damped * t) + decay / damped * np.sin(damped * t)
    assert after == pytest.approx(x[: model.modes] * np.exp(-decay * t) * wave, abs=1e-9)


def test_a_tumble_follows_eulers_equations() -> None:
    """About the middle axis it turns over (Dzhanibekov); J w' = -w x J w, without a torque."""
    inertia, rate = np.array([1.0, 2.0, 3.0]), np.array([0.01, 2.0, 0.02])
    model = spacecraft({"body_rate": rate.tolist()}).model()
    x = initial_state(spacecraft({"body_rate": rate.tolist()}))
    path = model.path(x, np.zeros((2000, 3)), 0.01)[:, -3:]
    exact = solve_ivp(
        lambda _, w: -np.cross(w, inertia * w) / inertia,
        (0.0, 20.0),
        rate,
        method="DOP853",
        t_eval=np.arange(1, 2001) * 0.01,
        rtol=1e-13,
        atol=1e-15,
    ).y.T
    assert exact[:, 1].min() < -1.9  # it has turned over
    assert abs(path - exact).max() < 1e-9


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        ({"rates": {"rol": 0.1}}, "rates.rol: not in this testbed; did you mean roll?"),
        ({"wheel_speeds": {"w": 1.0}}, "wheel_speeds.w: not in this testbed; it has none"),
        ({"gimbal_angles": {"g": 1.0}}, "gimbal_angles.g: not in this testbed; it has none"),
        ({"deflections": {"mode_1": 1.0}}, "deflections.mode_1: not in this testbed; it has none"),
        ({"plucked": {"boom_x": 1.0}}, "plucked.boom_x: not in this testbed; it has none"),
        ({"rates": {"roll": 0.1}, "body_rate": [0.0, 0.0, 1.0]}, "rates.roll: 0.1 is not allowed"),
        ({"body_rate": [0.0, 1.0]}, "body_rate"),
        ({"rate": {"roll": 0.1}}, "unknown key; did you mean rates?"),
        ({"rates": {"roll": float("nan")}}, "rates.roll"),
        ({"wheel_speeds": "fast"}, "wheel_speeds"),
    ],
)
def test_what_the_testbed_does_not_have_is_refused(motion: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput) as error:
        spacecraft(motion)
    assert words in str(error.value)
    assert "initial_motion" in str(error.value)


def test_a_wheel_beyond_its_speed_is_refused() -> None:
    with pytest.raises(BadInput, match=r"wheel_speeds\.a: 101\.0 .* at most 100 rad/s"):
        spacecraft({"wheel_speeds": {"a": 101.0}}, wheels=WHEELS)


def test_a_body_rate_needs_a_free_platform() -> None:
    with pytest.raises(BadInput, match=r"body_rate\.x: not in this testbed; it has none"):
        read_testbed({"kind": "csa", "initial_motion": {"body_rate": [0.1, 0.0, 0.0]}}, "here")


@pytest.mark.parametrize("kind", WITH_EQUATIONS)
def test_a_motion_among_the_positions_is_refused_with_its_place(kind: str) -> None:
    with pytest.raises(BadInput, match=r"initial\.rates: is a key of testbed\.initial_motion"):
        read_testbed({"kind": kind, "initial": {"rates": {"roll": 0.1}}}, "here")
