"""Reorientations of a rigid craft by the planner, and by a transcription with CasADi."""

from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation, Slerp
from tests.plants import torques

from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import read_testbed

NAMES = ("roll", "pitch", "yaw")
SPHERE, UNIT = (1.0, 1.0, 1.0), (1.0, 1.0, 1.0)
HALF_ROUND = (0.0, 0.0, np.pi)
ASKEW = (10.0, 14.0, 18.0), (1.0, 0.7, 1.2), (0.9, 1.4, -0.5)
PERIOD = 0.02  # [s]
Triple = tuple[float, float, float]


def craft(
    inertia: Triple, limit: Triple, start: Vector | None = None, keep_out: Any = None
) -> PlantDescription:
    """Return a rigid craft with a torque about each axis."""
    at = np.zeros(3) if start is None else start
    testbed = read_testbed(
        {
            "kind": "spacecraft",
            "platform": {"inertia": dict(zip(("xx", "yy", "zz"), inertia, strict=True))},
            "appendages": {},
            "actuators": torques(*limit),
            "initial": dict(zip(NAMES, at.tolist(), strict=True)),
            "keep_out": keep_out or {},
        },
        "here",
    )
    return PlantDescription(testbed, PERIOD, np.array(limit))


@lru_cache
def planned(inertia: Triple, limit: Triple, turn: Triple, **keys: Any) -> Plan:
    """Return the fastest slew by a rotation vector."""
    values = {"method": "time_optimal", "drives": "all", **keys}
    values["goal"] = dict(zip(NAMES, turn, strict=True))
    law = ActiveLaw("pd_feedforward", {"kp": [1.0], "kd": [2.0]})
    return make_plan(plan_settings(values, "here"), craft(inertia, limit), law=law)


class Guess(NamedTuple):
    """A smooth slew of a rigid craft, whose efforts are as good as none."""

    position: Matrix  # rotation vectors, (k, 3) [rad]
    velocity: Matrix  # in body axes, (k, 3) [rad/s]
    effort: Matrix  # (k, 3) [N m]
    duration: float  # [s]


class Keep(NamedTuple):
    """A cone and what keeps out of it."""

    boresight: Vector
    direction: Vector
    half: float  # [rad]


def through(passing: Rotation, turn: Triple, duration: float) -> Guess:
    """Return a smooth slew to the end of a rotation vector through an attitude in its middle."""
    s = np.linspace(0.0, 1.0, 400)
    ends = Rotation.concatenate([Rotation.identity(), passing, Rotation.from_rotvec(turn)])
    path = Slerp([0.0, 0.5, 1.0], ends)(3.0 * s**2 - 2.0 * s**3)
    rate = (path[:-1].inv() * path[1:]).as_rotvec() * (s.size - 1) / duration
    still = np.zeros((1, 3))
    return Guess(path.as_rotvec(), np.vstack((rate, still)), np.zeros((s.size, 3)), duration)


def beside(keep: Keep, turn: Triple, side: float) -> Rotation:
    """Return the attitude half-way, its boresight turned to one side of a cone."""
    middle = Rotation.from_rotvec(0.5 * np.array(turn))
    look = middle.apply(keep.boresight)
    ahead = np.cross(turn, look)  # the way of the boresight
    return Rotation.from_rotvec(side * (keep.half + 0.3) * ahead / np.linalg.norm(ahead)) * middle


def transcribed(
    inertia: Triple,
    limit: Triple,
    turn: Triple,
    guess: Plan | Guess,
    keep: Keep | None = None,
    rate_limit: float | None = None,
) -> float:
    """Return the least duration of efforts on 120 pieces, by IPOPT from another slew's [s].

    A boresight keeps out of its cone at the pieces' ends.
    """
    q, w, u, h = ca.SX.sym("q", 4), ca.SX.sym("w", 3), ca.SX.sym("u", 3), ca.SX.sym("h")
    x, moment = ca.vertcat(q, w), ca.DM(inertia)
    turned = 0.5 * ca.vertcat(q[3] * w + ca.cross(q[:3], w), -ca.dot(q[:3], w))
    pushed = (ca.DM(limit) * u - ca.cross(w, moment * w)) / moment
    rate = ca.Function("rate", [x, u], [ca.vertcat(turned, pushed)])
    k1 = rate(x, u)
    k2 = rate(x + h / 2.0 * k1, u)
    k3 = rate(x + h / 2.0 * k2, u)
    k4 = rate(x + h * k3, u)
    step = ca.Function("step", [x, u, h], [x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)])
    pieces, problem = 120, ca.Opti()
    states, shares = problem.variable(7, pieces + 1), problem.variable(3, pieces)
    duration = problem.variable()
    held = ca.repmat(duration / pieces, 1, pieces)
    problem.subject_to(states[:, 1:] == step.map(pieces)(states[:, :-1], shares, held))
    problem.subject_to(problem.bounded(-1.0, shares, 1.0))
    problem.subject_to(states[:, 0] == ca.DM([0, 0, 0, 1, 0, 0, 0]))
    goal = Rotation.from_rotvec(turn).as_quat()
    problem.subject_to(states[:3, -1] == ca.DM(goal[:3]))
    problem.subject_to(states[4:, -1] == 0.0)
    problem.subject_to(duration >= 0.1)
    if keep is not None:
        along = ca.repmat(ca.DM(keep.boresight), 1, pieces + 1)
        across = ca.cross(states[:3, :], along, 1)
        scalar = ca.repmat(states[3, :], 3, 1)
        look = along + 2.0 * (scalar * across + ca.cross(states[:3, :], across, 1))
        problem.subject_to(ca.DM(keep.direction).T @ look <= np.cos(keep.half))
    if rate_limit is not None:
        problem.subject_to(ca.sum1(states[4:, :] ** 2) <= rate_limit**2)
    problem.minimize(duration)
    share = np.linspace(0.0, 1.0, pieces + 1)
    ticks = np.minimum((share * (len(guess.position) - 1)).astype(int), len(guess.effort) - 1)
    attitude = Rotation.from_rotvec(guess.position[ticks]).as_quat()
    attitude *= np.sign(attitude[:, 3:] + 1e-300)
    problem.set_initial(states, np.hstack((attitude, guess.velocity[ticks])).T)
    problem.set_initial(shares, (guess.effort[ticks[:-1]] / np.array(limit)).T)
    problem.set_initial(duration, guess.duration)
    problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    return float(problem.solve().value(duration))
