"""The closed sampled loop of a trial about its goal, with an input for every error source."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.signal import fftconvolve

from flexslew_control.analysis.linear_plant import sampled_plant
from flexslew_control.analysis.loop import ControlLoop, loop_of, unstable_poles
from flexslew_control.analysis.rest import linear_matrices
from flexslew_control.analysis.rigid_motions import free_rigid_modes
from flexslew_control.analysis.signals import POSITION, states_of
from flexslew_control.controllers import build_controller
from flexslew_control.controllers.probing.running_law import running_law
from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.plan import Plan
from flexslew_lab.analysis.analysis import effort_columns
from flexslew_lab.analysis.trial_models import Point, plan_gains, point_of
from flexslew_lab.budget.estimate import (
    ErrorSystem,
    error_system,
    estimate_form,
    reading_turns,
)
from flexslew_lab.budget.noisy_instruments import NoisyInstruments
from flexslew_lab.budget.windows import KNOWLEDGE
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


class ErrorInputs(NamedTuple):
    """How error sources enter an ErrorSystem.

    Args:
        columns: B, shape (states, inputs).
        direct: D, shape (outputs, inputs).
    """

    columns: Matrix
    direct: Matrix

    def times(self, sizes: Matrix) -> "ErrorInputs":
        """Return inputs of these sizes, shape (inputs,), or mixed by a matrix (inputs, k)."""
        mix = np.diag(sizes) if sizes.ndim == 1 else sizes
        return ErrorInputs(self.columns @ mix, self.direct @ mix)


@dataclass(frozen=True)
class ErrorLoop:
    """The errors of a trial about its goal, and their sources as inputs.

    Args:
        controller: that closes the loop.
        point: about which it is linear.
        loop: plant and law.
        axes: of the errors.
        system: errors of pointing, then of knowledge, by errors of the plant's signals.
        signals: names of these.
        no_estimate: why there are no errors of knowledge; empty: there are.
    """

    controller: str
    point: Point
    loop: ControlLoop
    axes: ErrorAxes
    system: ErrorSystem
    signals: tuple[str, ...]
    no_estimate: str = ""

    def responses(self, inputs: ErrorInputs, ticks: int) -> Tensor:
        """Return impulse responses: h(0) = D, h(i) = C A^(i - 1) B.

        Args:
            inputs: B and D.
            ticks: how many.

        Returns:
            shape (ticks, outputs, inputs).
        """
        a, row = self.system.a, self.system.c
        rows = np.zeros((ticks, *row.shape))
        for k in range(1, ticks):
            rows[k] = row
            row = row @ a
        found = rows @ inputs.columns
        found[0] = inputs.direct
        return np.asarray(found)

    def signal_inputs(self, names: tuple[str, ...]) -> ErrorInputs:
        """Return the inputs of errors that add to signals of the plant.

        That of a joint's position is of its reading, see reading_turns.
        """
        which = [self.signals.index(name) for name in names]
        found = ErrorInputs(self.system.b[:, which], self.system.d[:, which])
        if not names or not names[0].startswith(POSITION):
            return found
        rest = self.point.rest
        return found.times(reading_turns(rest.model, rest.model.joint_state(rest.state)[0]))

    def command_inputs(self) -> ErrorInputs:
        """Return the inputs of errors that add to commands of the motors."""
        return self._padded(self.loop.closed.b[:, : self.loop.efforts])

    def effort_inputs(self) -> ErrorInputs:
        """Return the inputs of efforts that act on the plant, behind the motors [N m or N]."""
        return self._padded(effort_columns(self.loop, self.point))

    def force_inputs(self) -> ErrorInputs:
        """Return the inputs of generalised forces that are held over a tick, n of them."""
        rest, path = self.point.rest, self.point.path
        n = rest.model.coordinates
        a, _ = linear_matrices(rest, path.actuator)
        block = np.zeros((3 * n, 3 * n))
        block[: 2 * n, : 2 * n] = a
        block[n : 2 * n, 2 * n :] = np.linalg.inv(rest.model.mass_matrix(rest.q, rest.time))
        first = self.loop.closed.states.index(states_of(rest.model)[0])
        columns = np.zeros((len(self.loop.closed.a), n))
        columns[first : first + 2 * n] = expm(path.period * block)[: 2 * n, 2 * n :]
        return self._padded(columns)

    def _padded(self, columns: Matrix) -> ErrorInputs:
        """Return inputs that act on states of the closed loop alone."""
        found = np.zeros((len(self.system.a), columns.shape[1]))
        found[: len(columns)] = columns
        return ErrorInputs(found, np.zeros((len(self.system.c), columns.shape[1])))

    def named(self, values: Mapping[str, Matrix]) -> dict[str, Matrix]:
        """Return metrics of all outputs as those of pointing and of knowledge, by name."""
        k = len(self.axes.names)
        found = {metric: value[:, :k] for metric, value in values.items()}
        return found | {
            KNOWLEDGE[metric]: value[:, k:] for metric, value in values.items() if value[:, k:].size
        }


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
    sampled = sampled_plant(point.rest, point.path, applied=True)
    if isinstance(built.estimator, AttitudeEstimator):
        instruments = NoisyInstruments.of(built.estimator)
        built.use_estimator(instruments)
        sampled = instruments.with_errors_alone(sampled, point.rest.model.appendages.names)
    gains = plan_gains(plan, time)
    form = running_law(built, point.rest, plant.effort_limit, gains).form
    loop = loop_of(sampled, form)
    if not loop.sensors:
        raise BadInput(f"{source}: {name} reads no sensor there: it closes no loop")
    if unstable_poles(loop).size or free_rigid_modes(loop).joints:
        words = f"{source}: {name} is not stable there, so errors have no bound"
        raise BadInput(f"{words}; ./flexslew analyse shows why")
    axes, estimate, reason = error_axes(point.rest.model), None, ""
    try:
        estimate = estimate_form(built, point.rest, plant.effort_limit, gains)
    except BadInput as error:  # the errors of pointing need none
        reason = str(error)
    system = error_system(loop, sampled, estimate, axes.from_joints)
    return ErrorLoop(name, point, loop, axes, system, sampled.outputs, reason)
