"""The testbed, slews and optima of the tables and figures of Gorinevsky and Vukovich 1998."""

from functools import lru_cache
from typing import Any

import numpy as np

from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.gauss_newton import FeedforwardOptimum
from flexslew_control.planners.feedforward.manoeuvre import Manoeuvre, stage_times
from flexslew_control.planners.feedforward.optimized_feedforward import (
    OptimizedFeedforward,
    find_feedforward,
)
from flexslew_control.planners.feedforward.shooting import joint_loop, roll_out, stage_record
from flexslew_control.planners.progress import ignore
from flexslew_control.planners.trajectories import rest_to_rest
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.compiled.dynamics import STAGES
from flexslew_plant.testbeds.csa import CsaParameters, CsaTestbed
from flexslew_plant.testbeds.model import Model

KP, KD = 460.0, 920.0  # the gains (17) [N m/rad, N m s/rad]
GAINS: tuple[Vector, Vector] = (np.full(2, KP), np.full(2, KD))
STEP_ANGLE = 0.2  # of Figure 5 [rad]
DURATION = 25.0  # T_c [s]
OBSERVED = 100.0  # until when the tip is looked at [s]
INTERVAL = 0.02  # between the states that are looked at; the nodes are multiples of it [s]
REST: Vector = np.zeros(2)
M1 = (1.0, 0.5)  # goals (theta, psi) of the manoeuvres, from rest at zero [rad]
M3 = (np.pi / 2.0, np.pi / 4.0)
M8 = (1.0, 0.0)
MINIMUM_RHO = 4e-14  # its optimum is the smallest norm with Y = 0, (23)


def csa_model(modes: int = 1, stiffness: float = 1.0, variant: Any = "printed") -> Model:
    """Return the testbed of the paper."""
    parameters = CsaParameters(bending_stiffness=1500.0 * stiffness)
    return CsaTestbed(variant=variant, modes=modes, parameters=parameters).model()


def csa_slew(
    goal: tuple[float, float], stiffness: float = 1.0, variant: str = "printed"
) -> Manoeuvre:
    """Return the slew from rest at zero to rest at a goal."""
    return Manoeuvre(
        model=csa_model(1, stiffness, variant),
        kp=GAINS[0],
        kd=GAINS[1],
        start=REST,
        goal=np.array(goal),
        duration=DURATION,
        reference="cubic",
    )


def step_response() -> tuple[Vector, Matrix]:
    """Return times and states after a step of STEP_ANGLE in both references at psi = 0."""
    model = csa_model()
    n, edges = model.coordinates, np.linspace(0.0, 130.0, 6501)
    goal = np.tile(GAINS[0] * STEP_ANGLE, (STAGES * (len(edges) - 1), 1))
    loop, record = joint_loop(model, *GAINS), stage_record(goal, n)
    return edges, roll_out(loop, np.zeros(2 * n), edges, record)


@lru_cache
def csa_feedforward(goal: tuple[float, float], **changes: Any) -> tuple[Basis, FeedforwardOptimum]:
    """Return the feedforward of a slew, with its basis."""
    settings = OptimizedFeedforward(
        model={"variant": "printed"},
        goal={"base_yaw": goal[0], "hub_pitch": goal[1]},
        **changes,
    )
    return find_feedforward(settings, csa_slew(goal), ignore)


def simulate(
    goal: tuple[float, float], found: tuple[Basis, FeedforwardOptimum] | None, **bench: Any
) -> tuple[Vector, Matrix, Matrix]:
    """Return times, states and torques of a slew with this feedforward, or with none."""
    slew = csa_slew(goal, **bench)
    edges = np.linspace(0.0, OBSERVED, round(OBSERVED / INTERVAL) + 1)
    feedforward = np.zeros((STAGES * (len(edges) - 1), 2))
    added = np.zeros((len(edges), 2))
    if found is not None:
        basis, optimum = found
        weights = optimum.weights.reshape(2, -1).T
        feedforward = basis.values(stage_times(edges)) @ weights
        added = basis.values(edges) @ weights
    path = slew.fly(edges, feedforward)
    r = rest_to_rest("cubic", slew.start, slew.goal, slew.duration, edges)
    effort = added + slew.kp * (r.position - path[:, :2]) + slew.kd * (r.velocity - path[:, 3:5])
    return edges, path, effort


def residual_tip(
    goal: tuple[float, float], found: tuple[Basis, FeedforwardOptimum] | None, **bench: Any
) -> float:
    """Return the largest tip deflection after the manoeuvre [m]."""
    t, x, _ = simulate(goal, found, **bench)
    return float(np.abs(x[t >= DURATION, 2]).max())
