"""The closed sampled loop of a trial about its goal, with an input for every error source."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm
from scipy.signal import fftconvolve

from flexslew_control.analysis.linear_plant import sampled_plant
from flexslew_control.analysis.loop import ControlLoop, loop_of, unstable_poles
from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.rest import linear_matrices
from flexslew_control.analysis.rigid_motions import free_rigid_modes
from flexslew_control.controllers import build_controller
from flexslew_control.controllers.probing.running_law import running_law
from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.plan import Plan
from flexslew_lab.analysis.trial_models import Point, point_of
from flexslew_lab.budget.knowledge import NoisyInstruments
from flexslew_lab.trial.trial import Trial, active_controller, law_of, plant_of
from flexslew_plant.arrays import Matrix, Tensor
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.model import Model


@dataclass(frozen=True)
class ErrorAxes:
    """The axes of a pointing error.

    Args:
        names: x, y and z of a platform's turn in body axes, else the joints.
        units: rad or m.
        from_joints: from errors of joints to these, shape (axes, joints).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    from_joints: Matrix


def error_axes(model: Model) -> ErrorAxes:
    """Return the axes of the pointing error of a testbed."""
    if model.attitude is None:
        return ErrorAxes(model.joint_names, model.joint_units, np.eye(model.joints))
    turns = np.asarray(model.attitude.rotation_vector_of(np.eye(model.joints))).T
    return ErrorAxes(("x", "y", "z"), ("rad",) * 3, turns)


@dataclass(frozen=True)
class ErrorLoop:
    """x(k + 1) = A x(k) + B w(k), e(k) = C x(k), w an error source, e the pointing error.

    Args:
        controller: that closes the loop.
        point: about which it is linear.
        loop: plant and law.
        axes: of e.
    """

    controller: str
    point: Point
    loop: ControlLoop
    axes: ErrorAxes

    @property
    def closed(self) -> Lti:
        """The closed loop."""
        return self.loop.closed

    @property
    def output(self) -> Matrix:
        """C, shape (axes, states)."""
        return np.asarray(self.axes.from_joints @ self.loop.joint_positions)

    def responses(self, columns: Matrix, ticks: int) -> Tensor:
        """Return impulse responses h(i) = C A^(i - 1) B, h(0) = 0.

        Args:
            columns: B, shape (states, inputs).
            ticks: how many.

        Returns:
            shape (ticks, axes, inputs).
        """
        a, row = self.closed.a, self.output
        rows = np.zeros((ticks, *row.shape))
        for k in range(1, ticks):
            rows[k] = row
            row = row @ a
        return np.asarray(rows @ columns)

    def sensor_columns(self, names: tuple[str, ...]) -> Matrix:
        """Return B of errors that add to readings, zero of what the law does not read."""
        closed = self.closed
        return np.column_stack([
            closed.b[:, closed.inputs.index(n)] if n in closed.inputs else np.zeros(len(closed.a))
            for n in names
        ])  # fmt: skip

    def effort_columns(self) -> Matrix:
        """Return B of efforts that act on the plant, behind the motors [1/(N m) or 1/N]."""
        path = self.point.path
        bare = replace(path, actuator=replace(path.actuator, lag=0.0), gain=None, delay=None)
        plant = sampled_plant(self.point.rest, bare)
        return self._on_motion(plant.b[: 2 * self.point.rest.model.coordinates])

    def force_columns(self) -> Matrix:
        """Return B of generalised forces that are held over a tick, shape (states, n)."""
        rest, path = self.point.rest, self.point.path
        n = rest.model.coordinates
        a, _ = linear_matrices(rest, path.actuator)
        block = np.zeros((3 * n, 3 * n))
        block[: 2 * n, : 2 * n] = a
        block[n : 2 * n, 2 * n :] = np.linalg.inv(rest.model.mass_matrix(rest.q, rest.time))
        return self._on_motion(expm(path.period * block)[: 2 * n, 2 * n :])

    def _on_motion(self, columns: Matrix) -> Matrix:
        """Return columns of the plant's motion among all states."""
        states = self.closed.states
        first = next(k for k, name in enumerate(states) if name == self._first_motion)
        found = np.zeros((len(states), columns.shape[1]))
        found[first : first + len(columns)] = columns
        return found

    @property
    def _first_motion(self) -> str:
        path = replace(self.point.path, actuator=replace(self.point.path.actuator, lag=0.0))
        return sampled_plant(self.point.rest, replace(path, gain=None, delay=None)).states[0]


def response_to(response: Tensor, series: Matrix) -> Matrix:
    """Return the errors that inputs cause, shape (ticks, axes).

    Args:
        response: impulse responses, shape (ticks, axes, inputs).
        series: inputs, shape (ticks, inputs).
    """
    ticks, used = len(series), series.any(axis=0)
    if not used.any():
        return np.zeros((ticks, response.shape[1]))
    found = fftconvolve(response[:ticks, :, used], series[:, None, used], axes=0)
    return np.asarray(found[:ticks].sum(axis=2))


def error_loop(
    trial: Trial, source: str, plan: Plan | None, time: float, controller: str | None = None
) -> ErrorLoop:
    """Return the loop of a trial about the place where its plan is at a time.

    Args:
        trial: of the budget.
        source: its file, for an error.
        plan: that is flown; None: the trial has none.
        time: simulated time [s].
        controller: by name; None: the active one then.

    Raises:
        BadInput: if there is no such controller, or it has no linear form or no stable loop there.
    """
    name = controller or active_controller(trial, time)
    if name not in trial.controllers:
        known = ", ".join(trial.controllers)
        raise BadInput(f"{source}: --controller: {name} is not in controllers; allowed: {known}")
    point, plant = point_of(trial, time, None, plan), plant_of(trial)
    law, values = law_of(name, trial.controllers[name] or {})
    built = build_controller(name, law, values, plant, f"{source}: controllers.{name}")
    if isinstance(built.estimator, AttitudeEstimator):
        built.use_estimator(NoisyInstruments.of(built.estimator))
    gains = None
    if plan is not None and plan.gains.size:
        gains = plan.reference(round(time / trial.period)).gains
    form = running_law(built, point.rest, plant.effort_limit, gains).form
    loop = loop_of(sampled_plant(point.rest, point.path, applied=True), form)
    if not loop.sensors:
        raise BadInput(f"{source}: {name} reads no sensor there: it closes no loop")
    if unstable_poles(loop).size or free_rigid_modes(loop).joints:
        words = f"{source}: {name} is not stable there, so errors have no bound"
        raise BadInput(f"{words}; ./flexslew analyse shows why")
    return ErrorLoop(name, point, loop, error_axes(point.rest.model))
