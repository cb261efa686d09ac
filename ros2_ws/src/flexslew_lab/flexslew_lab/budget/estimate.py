"""What a law takes the joints for, as a linear system from all signals of the plant.

It is the estimate of the law's own code, by the same differences as its linear form: a controller
whose law returns the estimated positions in place of efforts.
"""

from typing import NamedTuple, cast

import numpy as np
from scipy.optimize import approx_fprime

from flexslew_control.analysis.loop import ControlLoop
from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.numeric_state import copied
from flexslew_control.analysis.rest import Rest
from flexslew_control.analysis.signals import applied_of, outputs_of
from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.probing.probed_controller import ProbeController
from flexslew_control.law import Estimate, Reference
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.model import Model


class EstimateLaw:
    """A law whose efforts are the estimated positions of the joints."""

    def __init__(self) -> None:
        self.terms: dict[str, Vector] = {}

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Start; it has no state."""

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the estimated positions, shape (joints,) [rad or m]."""
        return np.array(estimate.position[: measurement.joint_position.size])


class ErrorSystem(NamedTuple):
    """x(k + 1) = A x(k) + B w(k), e(k) = C x(k) + D w(k), w errors of the plant's signals.

    e is the pointing error, position less goal, then the error of knowledge, estimate less
    position, where an estimate is known; each on all axes.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix


def reading_turns(model: Model, position: Vector) -> Matrix:
    """Return the slope of errors of joints by errors of their readings, shape (joints, joints).

    Joints that read an attitude are rotation vectors: an error of theirs is the turn between the
    attitudes of both readings.
    """
    if model.attitude is None:
        return np.eye(model.joints)

    def turn(reading_error: Vector) -> Vector:
        return -model.joint_error(position + reading_error, position)

    return np.asarray(approx_fprime(np.zeros(model.joints), turn))


def estimate_form(controller: Controller, rest: Rest, limit: Vector, gains: Vector | None) -> Lti:
    """Return the form of a controller's estimate: from all signals to positions of joints.

    A controller has positions of an attitude as the reference and the turn from it, so that
    differences are turns.

    Args:
        controller: as built; it stays as it is.
        rest: about which.
        limit: of the efforts, shape (efforts,).
        gains: of a law that takes them from its plan; None: none.

    Raises:
        BadInput: if it gives no estimate at rest.
    """
    observer: Controller = copied(controller)
    observer.__dict__["_law"] = EstimateLaw()
    probe = ProbeController(observer, rest, limit, gains)
    probe.settle()
    a, b, c, d = probe.slopes(probe.memory())
    signals = (*outputs_of(rest.model), *applied_of(rest.model))
    count = len(signals)
    states = tuple(f"estimate.{k + 1}" for k in range(len(a)))
    names = tuple(f"estimate.{name}" for name in rest.model.joint_names)
    return Lti(a, b[:, :count], c, d[:, :count], signals, names, states, controller.period)


def error_system(
    loop: ControlLoop, plant: Lti, estimate: Lti | None, from_joints: Matrix
) -> ErrorSystem:
    """Return errors of pointing and knowledge by errors of all signals of the plant.

    Args:
        loop: closed by the law.
        plant: its plant, with all signals.
        estimate: of the law; None: not known, and there are no errors of knowledge.
        from_joints: from errors of joints to the axes.
    """
    closed, signals = loop.closed, plant.outputs
    b = np.zeros((len(closed.a), len(signals)))
    for k, name in enumerate(signals):
        if name in closed.inputs:
            b[:, k] = closed.b[:, closed.inputs.index(name)]
    c = from_joints @ loop.joint_positions
    if estimate is None:
        return ErrorSystem(closed.a, b, c, np.zeros((len(c), len(signals))))
    order = [estimate.inputs.index(name) for name in signals]
    reading = np.zeros((len(signals), len(closed.a)))
    reading[:, : len(plant.a)] = plant.c
    to_estimate, direct = estimate.b[:, order], from_joints @ estimate.d[:, order]
    states = len(estimate.a)
    return ErrorSystem(
        cast(Matrix, np.block([
            [closed.a, np.zeros((len(closed.a), states))], [to_estimate @ reading, estimate.a]
        ])),
        np.vstack((b, to_estimate)),
        cast(Matrix, np.block([
            [c, np.zeros((len(c), states))],
            [direct @ reading - c, from_joints @ estimate.c],
        ])),
        np.vstack((np.zeros((len(c), len(signals))), direct)),
    )  # fmt: skip
