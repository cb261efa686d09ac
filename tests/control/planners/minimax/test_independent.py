"""Optima computed a second time, with equations, transcription and solver of their own.

The oscillator by a linear program (HiGHS) on matrix exponentials: an amplitude is bounded from
below by its projections on 32 directions, and ticks are left out, so the program is a lower bound
that is at most 0.5 % off. The hub by a nonlinear program (IPOPT) on its energies.
"""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import linprog
from tests.plants import plant
from tests.present import present

from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.testbeds import read_testbed

PERIOD = 0.01  # [s]
STIFFNESS = np.linspace(0.8, 1.2, 5)  # of the members
DIRECTIONS = np.pi * np.arange(32) / 16.0


def planned(kind: str, period: float = PERIOD, **section: Any) -> Any:
    testbed = read_testbed({"kind": kind}, "test")
    values = {"method": "minimax_feedforward", "ensemble": {"count": 5}, **section}
    return make_plan(plan_settings(values, "test"), plant(period, testbed.effort_limit, testbed))


def edges(duration: float, pieces: int = 60) -> Any:
    """Return the ticks at which the pieces begin and end."""
    return np.round(np.linspace(0.0, duration / PERIOD, pieces + 1)).astype(int)


def least(slopes: Any, offsets: Any, equal: Any, values: Any) -> float:
    """Return the least g with slopes u - offsets <= g for |u| <= 1 and equal u = values."""
    a, b = np.vstack(slopes), np.concatenate(offsets)
    bounds = [(-1.0, 1.0)] * equal.shape[1] + [(0.0, None)]
    equal = np.pad(equal, ((0, 0), (0, 1)))
    goal = np.eye(len(bounds))[-1]
    found = linprog(goal, a, b, equal, values, bounds, method="highs")
    assert found.success
    return present(found.fun)


def free_motion(duration: float) -> tuple[Any, Any]:
    """Return what one unit of each piece adds to rate and way of the centre of mass (2 kg)."""
    begin, end = (PERIOD * edges(duration)[k : k + 60] for k in (0, 1))
    way = ((duration - begin) ** 2 - (duration - end) ** 2) / 4.0
    return np.vstack(((end - begin) / 2.0, way)), np.array([0.0, 1.0])


def least_amplitude(duration: float, exact: bool, stiffness: Any) -> float:
    """Return the bound for members of this stiffness [m].

    Two masses of 1 kg: q'' = -2 k q - u for the distance q of the free one.
    """
    to_go = duration - PERIOD * edges(duration)
    slopes, offsets = [], []
    equal, values = free_motion(duration)
    for k in stiffness:
        w = np.sqrt(2.0 * k)
        both = -np.vstack((np.diff(np.cos(w * to_go)), -np.diff(np.sin(w * to_go)))) / w**2
        if exact and k == 1.0:
            equal, values = np.vstack((equal, both)), np.append(values, [0.0, 0.0])
        turned = np.outer(np.cos(DIRECTIONS), both[0]) + np.outer(np.sin(DIRECTIONS), both[1])
        slopes.append(np.pad(turned, ((0, 0), (0, 1)), constant_values=-1.0))
        offsets.append(np.zeros(DIRECTIONS.size))
    return least(slopes, offsets, equal, values)


@pytest.mark.parametrize(("duration", "exact"), [(6.5, False), (9.0, False), (6.5, True)])
def test_without_feedback_the_least_amplitude_is_that_of_a_linear_program(
    duration: float, exact: bool
) -> None:
    none = {"kp": [0.0], "kd": [0.0]}
    section: dict[str, Any] = {"goal": {"mass": 1.0}, "duration": duration, "feedback": none}
    found = planned("floating_oscillator", **section, exact_nominal=exact).summary
    # members between those of the grid join where they would be left with more
    least_of_grid, least_of_all = (
        least_amplitude(duration, exact, stiffness)
        for stiffness in (STIFFNESS, np.linspace(0.8, 1.2, 33))
    )
    assert found["worst_residual"] >= least_of_grid * (1.0 - 1e-6)
    assert found["worst_residual"] <= 1.007 * least_of_all


@pytest.mark.parametrize("duration", [6.5, 9.0])
def test_under_the_feedback_the_least_tip_is_that_of_a_linear_program(duration: float) -> None:
    """x = (y, q, y', q') of every member beside the nominal one, tick by tick."""
    gains, at = np.array([[0.5, 0.0, 1.0, 0.0]]), edges(duration)

    def step(k: float) -> tuple[Any, Any]:
        a = np.zeros((5, 5))
        a[:2, 2:4] = np.eye(2)
        a[2:4, :5] = [[0.0, k, 0.0, 0.0, 1.0], [0.0, -2.0 * k, 0.0, 0.0, -1.0]]
        both = expm(PERIOD * a)
        return both[:4, :4], both[:4, 4:]

    f0, g0 = step(1.0)
    slopes, offsets = [], []
    for k in STIFFNESS:
        f, g = step(k)
        x, r = np.zeros((4, 61)), np.zeros((4, 61))  # by the 60 pieces, and of the goal
        demands, tips = [], []
        for tick in range(at[-1] + 2500):
            over = tick >= at[-1]
            w = np.zeros((1, 61))
            if over:
                r = np.zeros((4, 61))
                r[0, 60] = 1.0
            else:
                piece = int(np.searchsorted(at, tick, side="right")) - 1
                w[0, piece] = 1.0
            u = w + gains @ (r - x)
            if over and (tick - at[-1]) % 10 == 0:
                tips.append(x[1])
            if not over and (tick in at or tick + 1 in at):
                demands.append(u[0])
            x = f @ x + g @ u
            if not over:
                r = f0 @ r + g0 @ w
            if tick == at[-1] - 1 and k == 1.0:
                end = x
        for found_rows, g_too in ((tips, -1.0), (demands, 0.0)):
            rows = np.array(found_rows)
            for side in (1.0, -1.0):
                slopes.append(np.column_stack((side * rows[:, :60], np.full(len(rows), g_too))))
                offsets.append((1.0 + g_too) - side * rows[:, 60])
    bound = least(slopes, offsets, end[:, :60], np.array([1.0, 0.0, 0.0, 0.0]))
    found = planned(
        "floating_oscillator", goal={"mass": 1.0}, duration=duration, exact_nominal=True,
        feedback={"kp": [0.5], "kd": [1.0]},
    ).summary  # fmt: skip
    assert bound * (1.0 - 1e-6) <= found["worst_residual"] <= 1.007 * bound


def hub(stiffness: float, pieces: int, held: int) -> Any:
    """Return the square of the hub's amplitude [ft^2] and its rigid motion at the end, by CasADi.

    2 T = a h'^2 + 2 b h' q' + c q'^2, U = k q^2 with the printed numbers of Liu and Singh (1997).
    """
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    q, rates = x[1], x[2:]
    mass = ca.SX(2, 2)
    mass[0, 0] = 18.09815 - 8.902248 * q**2 + 18.278027 * q**4
    mass[0, 1] = mass[1, 0] = 13.152322 + 17.930085 * q**2
    mass[1, 1] = 17.653088 + 73.112108 * q**2
    twice, k = ca.mtimes([rates.T, mass, rates]), 170.310339 * stiffness
    swept = ca.jtimes(ca.mtimes(mass, rates), x[:2], rates) - ca.gradient(twice, x[:2]) / 2.0
    acceleration = ca.solve(mass, ca.vertcat(u, -2.0 * k * q) - swept)
    rate = ca.Function("rate", [x, u], [ca.vertcat(rates, acceleration)])
    now = x
    for _ in range(2 * held):  # two steps in a tick of 0.05 s
        h, one = 0.025, rate(now, u)
        two = rate(now + h / 2.0 * one, u)
        three = rate(now + h / 2.0 * two, u)
        now = now + h / 6.0 * (one + 2.0 * two + 2.0 * three + rate(now + h * three, u))
    piece = ca.Function("piece", [x, u], [now])
    efforts = ca.MX.sym("efforts", pieces)
    course = piece.mapaccum(pieces)(ca.DM.zeros(4), efforts.T)
    end = course[:, -1] - ca.DM([1.0, 0.0, 0.0, 0.0])
    still, spring = (
        np.array([[18.09815, 13.152322], [13.152322, 17.653088]]),
        np.diag([0.0, 2.0 * k]),
    )
    square, shapes = np.linalg.eigh(np.linalg.solve(np.linalg.cholesky(still), np.linalg.solve(
        np.linalg.cholesky(still), spring).T))  # fmt: skip
    modes = np.linalg.solve(np.linalg.cholesky(still).T, shapes)
    motion = (modes.T @ still) @ ca.horzcat(end[:2], end[2:])  # rigid, then bent
    tip = 6.934802 * modes[1, 1]  # phi(L) = 2 + pi^2/2
    bent = tip**2 * (motion[1, 0] ** 2 + motion[1, 1] ** 2 / square[1])
    return ca.Function("hub", [efforts], [bent, motion[0, :]])


@pytest.mark.slow
def test_the_hub_is_no_further_from_its_optimum_than_a_nonlinear_program_finds() -> None:
    """One radian in 6.1 s (least time: 6.02 s) with 2 ft lb, stiffness within 20 %."""
    pieces, held = 61, 2
    u, square = ca.MX.sym("u", pieces), ca.MX.sym("square")  # of the amplitude, [1e-4 ft^2]
    rows = []
    for stiffness in (1.0, 0.8, 1.2):
        bent, rigid = hub(stiffness, pieces, held)(u)
        rows.append(1e4 * bent - square)
        if stiffness == 1.0:
            rows += [rigid[0], rigid[1]]
    problem = {"x": ca.vertcat(u, square), "f": square, "g": ca.vertcat(*rows)}
    ipopt: dict[str, int | str] = {
        "print_level": 0,
        "sb": "yes",
        "hessian_approximation": "limited-memory",
    }
    solver = ca.nlpsol("least", "ipopt", problem, {"ipopt": ipopt, "print_time": False})
    start = np.append(2.0 * np.sign(0.5 * pieces - np.arange(pieces)), 10.0)
    most, least = np.append(np.full(pieces, 2.0), np.inf), [-np.inf, 0.0, 0.0, -np.inf, -np.inf]
    found = solver(x0=start, lbx=np.append(-most[:-1], 0.0), ubx=most, lbg=least, ubg=0.0)
    assert solver.stats()["success"]
    best = 0.3048 * 1e-2 * float(found["f"]) ** 0.5
    section: dict[str, Any] = {"goal": {"hub": 1.0}, "duration": 6.1, "pieces": pieces}
    section |= {"ensemble": {"draw": "corners"}, "feedback": {"kp": [0.0], "kd": [0.0]}}
    made = planned("hub_with_appendages", 0.05, **section).summary["worst_residual"]
    assert 0.97 * best < made < 1.03 * best
