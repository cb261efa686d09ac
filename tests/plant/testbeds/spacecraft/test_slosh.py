"""A passive hinge with a mass: propellant that swings as a pendulum while thrusters push."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds import read_testbed

MASS, INERTIA = 400.0, 150.0  # of the platform, about its centre [kg, kg m^2]
LIQUID, LENGTH = 40.0, 0.5  # [kg, m]
PLACE = 0.8  # of the hinge ahead of the platform's centre [m]
THRUST = 44.0  # along x [N]
LASTING, PERIOD = 1000.0, 0.25  # [s]


def pushed(angle: float, damper: float = 0.0) -> Bench:
    """Return the bench that a constant thrust has pushed, the pendulum at rest at this angle."""
    square = LIQUID * LENGTH**2
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "platform": {"mass": MASS, "inertia": {"xx": 100.0, "yy": INERTIA, "zz": INERTIA}},
            "appendages": {
                "tank": {
                    "hinge": {
                        "kind": "passive",
                        "place": [PLACE, 0.0, 0.0],
                        "axis": [0.0, 0.0, 1.0],
                        "turned": {"axis": [0.0, 0.0, 1.0], "angle": angle},
                        "damper": damper,
                    },
                    "body": {
                        "mass": LIQUID,
                        "centre": [-LENGTH, 0.0, 0.0],
                        "inertia": {"yy": square, "zz": square},
                    },
                }
            },
            "actuators": {"thrust": {"kind": "force", "direction": [1, 0, 0], "limit": 100.0}},
        },
        "here",
    )
    bench = Bench(BenchSettings(testbed=testbed, period=PERIOD, duration=LASTING + 1.0))
    for _ in range(round(LASTING / PERIOD)):
        asked = bench.question
        command = EffortCommand(asked.tick, asked.epoch, asked.controller, np.array([THRUST]))
        assert bench.offer(command)
        bench.advance()
    return bench


def angles(bench: Bench) -> tuple[float, float]:
    """Return the turns of platform and pendulum about z [rad]."""
    q = bench.truth().position
    return float(2.0 * np.arctan2(q[5], q[6])), float(q[7])


def two_bodies(angle: float, damper: float) -> tuple[float, float]:
    """Return the same two turns by Lagrange's equations of a body and a point, in the plane.

    With r = (x, y) + R(f) h - R(f + g) l of the point: sum m J^T J q'' = Q - sum m J^T J' q'.
    """

    def slope(t: float, state: Vector) -> Vector:
        f, g, (spin, swing) = state[2], state[3] + angle, state[6:]
        rod = LENGTH * np.array([np.cos(f + g), np.sin(f + g)])
        arm = PLACE * np.array([np.cos(f), np.sin(f)])
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        j: Matrix = np.column_stack((np.eye(2), quarter @ (arm - rod), -quarter @ rod))
        convective = -arm * spin**2 + rod * (spin + swing) ** 2
        mass = LIQUID * j.T @ j + np.diag([MASS, MASS, INERTIA, 0.0])
        force = np.array([np.cos(f) * THRUST, np.sin(f) * THRUST, 0.0, -damper * swing])
        return np.concatenate((state[4:], np.linalg.solve(mass, force - LIQUID * j.T @ convective)))

    end = solve_ivp(
        slope, (0.0, LASTING), np.zeros(8), "DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]  # fmt: skip
    return float((end[2] + np.pi) % (2.0 * np.pi) - np.pi), float(end[3])


def test_small_swings_have_the_frequency_of_the_closed_form_over_1000_s() -> None:
    """w^2 = a / L (1 + m / M + m h (h - L) / J), and the platform swings against them.

    The amplitude A shifts the phase by w t A^2 / 16, here 3e-6 rad, of swings of 3e-4.
    """
    start = 3e-4
    acceleration = THRUST / (MASS + LIQUID)
    corrected = 1.0 + LIQUID / MASS + LIQUID * PLACE * (PLACE - LENGTH) / INERTIA
    rate = np.sqrt(acceleration / LENGTH * corrected)
    share = LIQUID * PLACE * acceleration / (INERTIA * rate**2)
    swing = start * (np.cos(rate * LASTING) - 1.0)
    turn, hinge = angles(pushed(start))
    assert hinge == pytest.approx(swing, abs=1e-7)
    assert turn == pytest.approx(share * swing, abs=1e-7)
    assert abs(share * swing) > 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(("start", "damper"), [(0.4, 0.0), (1.2, 0.05)])
def test_large_swings_turn_the_platform_as_the_equations_of_two_bodies_say(
    start: float, damper: float
) -> None:
    expected = two_bodies(start, damper)
    turn, hinge = angles(pushed(start, damper))
    assert turn == pytest.approx(expected[0], abs=1e-6)
    assert hinge == pytest.approx(expected[1], abs=1e-6)
