"""What output feedback control is designed for: here all joints and modes of the bench.

The observer and the law (see output_feedback) are the same for every one.
"""

from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexslew_control.controllers.sliding.sliding_surface import LinearSystem
from flexslew_control.estimators.kalman import outputs
from flexslew_control.estimators.prediction import first_state, steady_prediction
from flexslew_control.law import Estimate, LawFailed, Reference, nominal_state
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.model import Model

Mask: TypeAlias = NDArray[np.bool_]


def inverse(a: Matrix) -> Matrix:
    """Return a^-1, shape (m, m).

    Raises:
        LawFailed: it is singular, as where an estimate has lost itself.
    """
    try:
        return np.asarray(np.linalg.inv(a), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise LawFailed("no effort moves its surface where it believes to be") from None


class DesignModel(Protocol):
    """z' = f(z, u) + known disturbances, as the law controls it, and what belongs to it."""

    @property
    def joint_rows(self) -> Mask:
        """Which entries of z are joints and their rates, shape (k,)."""

    def drift(self, z: Vector, reference: Reference) -> Vector:
        """Return f(z, 0), known disturbances with it, shape (k,)."""

    def effectiveness(self, z: Vector, surface: Matrix) -> Matrix:
        """Return (G B)^-1, shape (m, m)."""

    def nominal_state(self, reference: Reference) -> tuple[Vector, Vector]:
        """Return z* and z*', each of shape (k,)."""

    def on_bench(self, effort: Vector) -> Vector:
        """Return efforts of B in the order of the bench's joints, shape (joints,)."""

    def platform(self, measurement: Measurement, reference: Reference) -> dict[str, Vector]:
        """Return efforts by name that hold what z leaves out, each of shape (joints,)."""

    def state(self, estimate: Estimate) -> Vector:
        """Return z of an estimate, shape (k,)."""


class ObservedModel(Protocol):
    """The same as an observer with a stationary gain sees it, y = C z."""

    @property
    def system(self) -> LinearSystem:
        """Its linearisation."""

    def start(self, measurement: Measurement) -> Vector:
        """Return z at rest with straight appendages, shape (k,)."""

    def outputs(self, measurement: Measurement) -> Vector:
        """Return y, shape (l,)."""

    def efforts(self, measurement: Measurement) -> Vector:
        """Return the efforts of B that were applied during the last tick, shape (m,)."""

    def propagate(
        self, z: Vector, y: Vector, effort: Vector, gain: Matrix, reference: Reference | None
    ) -> Vector:
        """Return z one tick later under z' = f(z, u) + K_f (y - C z), y and u held.

        Args:
            z: estimate, shape (k,).
            y: outputs, shape (l,).
            effort: u, shape (m,).
            gain: K_f, shape (k, l).
            reference: of that tick, if it is known.
        """

    def error_step(self) -> tuple[Matrix, Matrix]:
        """Return F, (k, k), and H, (k, l): at rest a tick turns an error e into F e - H v.

        v is the noise of the sensors, held over the tick.
        """

    def estimate(self, z: Vector, measurement: Measurement) -> tuple[Vector, Vector]:
        """Return positions and rates, the joints first."""


def observer_step(system: LinearSystem, gain: Matrix, period: float) -> Matrix:
    """Return S of z+ = S (z, u, y), exact for z' = (A - K_f C) z + B u + K_f y over a tick.

    Args:
        system: A (k, k), B (k, m) and C (p, k).
        gain: K_f, shape (k, p).
        period: [s].

    Returns:
        of shape (k, k + m + p).
    """
    inputs = np.hstack((system.b, gain))
    return np.hstack(zero_order_hold(system.a - gain @ system.c, inputs, period))


@dataclass
class JointsAndModes:
    """z = [q, v] of the whole model.

    Args:
        model: equations of motion.
        system: its linearisation at the rest z0, shape (2 n,).
        origin: z0.
        linear: whether f(z, u) is A (z - z0) + B u.
        period: one tick [s].
        elastic: False holds the appendages straight (z* with q* = 0).
        gain: K_f, of the observer that it is used with.
    """

    model: Model
    system: LinearSystem
    origin: Vector
    linear: bool
    period: float
    elastic: bool
    gain: Matrix
    _step: Matrix = field(init=False)
    _effectiveness: Matrix | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Precompute what does not change."""
        n, m = self.model.coordinates, self.model.joints
        self._joint_rows = np.tile(np.arange(n) < m, 2)
        self._no_effort = np.zeros(m)
        self._step = observer_step(self.system, self.gain, self.period)
        self._feedback: Matrix = self.gain @ self.system.c
        model = self.model
        self._predict = steady_prediction(lambda _, z, effort: model.derivative(z, effort))

    @property
    def joint_rows(self) -> Mask:
        """Which entries of z are joints and their rates, shape (k,)."""
        return self._joint_rows

    def start(self, measurement: Measurement) -> Vector:
        """Return the measured joints with straight appendages at rest."""
        n = self.model.coordinates
        return first_state(self.outputs(measurement), n, 2 * n)

    def outputs(self, measurement: Measurement) -> Vector:
        """Return joints, their rates and, if used, the first tip."""
        return outputs(measurement, len(self.system.c))

    def efforts(self, measurement: Measurement) -> Vector:
        """Return the efforts of the joints."""
        return measurement.applied_effort

    def propagate(
        self, z: Vector, y: Vector, effort: Vector, gain: Matrix, reference: Reference | None
    ) -> Vector:
        """Return z one tick later: exactly where it is linear, else by a step of RK4."""
        if self.linear:
            y = y - self.system.c @ self.origin
            return self.origin + self._step @ np.concatenate((z - self.origin, effort, y))
        return self._predict(EMPTY, z, effort, gain @ y, self._feedback, self.period)

    def error_step(self) -> tuple[Matrix, Matrix]:
        """Return what a tick makes of errors and of held sensor noise."""
        k, p = len(self.system.a), len(self.system.c)
        if self.linear:
            return self._step[:, :k], self._step[:, -p:]
        h, eye = self.period, np.eye(k)
        drift = h * (self.system.a - self._feedback)
        mean = eye + drift / 2.0 @ (eye + drift / 3.0 @ (eye + drift / 4.0))
        return eye + drift @ mean, h * mean @ self.gain

    def drift(self, z: Vector, reference: Reference) -> Vector:
        """Return f(z, 0)."""
        if self.linear:
            return self.system.a @ (z - self.origin)
        return self.model.derivative(z, self._no_effort)

    def effectiveness(self, z: Vector, surface: Matrix) -> Matrix:
        """Return (G B)^-1 with B at z, or at the set point where it is linear."""
        if self.linear:
            if self._effectiveness is None:
                self._effectiveness = inverse(surface @ self.system.b)
            return self._effectiveness
        return inverse(surface @ self.model.jacobian(z, self._no_effort)[1])

    def nominal_state(self, reference: Reference) -> tuple[Vector, Vector]:
        """Return z* and the mean of its derivative over the coming tick."""
        m, modes = self.model.joints, self.model.modes
        now = nominal_state(reference.state, reference, m, modes)
        if reference.next_state.size:
            later = nominal_state(reference.next_state, reference, m, modes)
            slope = (later - now) / self.period
        else:
            slope = self.model.derivative(now, reference.effort)
        if self.elastic:
            return now, slope
        return now * self._joint_rows, slope * self._joint_rows

    def nominal_states(self, references: list[Reference]) -> tuple[Matrix, Matrix]:
        """Return the same at N references, shape (N, 2 n) each."""
        sizes = {(one.state.size, one.next_state.size) for one in references}
        if len(sizes) == 1 and references[0].next_state.size:
            rows = [np.array(column) for column in list(zip(*references, strict=True))[:5]]
            return self.nominal_state(Reference(*rows))
        pairs = [self.nominal_state(one) for one in references]
        states, slopes = (np.array(column) for column in zip(*pairs, strict=True))
        return states, slopes

    def on_bench(self, effort: Vector) -> Vector:
        """Return the efforts as they are."""
        return effort

    def platform(self, measurement: Measurement, reference: Reference) -> dict[str, Vector]:
        """Return nothing: z holds every joint."""
        return {}

    def estimate(self, z: Vector, measurement: Measurement) -> tuple[Vector, Vector]:
        """Return q and v."""
        n = self.model.coordinates
        return z[:n], z[n:]

    def state(self, estimate: Estimate) -> Vector:
        """Return [q, v]."""
        return np.concatenate((estimate.position, estimate.velocity))
