"""What output feedback control is designed for where one appendage is estimated alone."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from flexslew_control.controllers.linear_form import LinearForm, LinearObserver, observed_form
from flexslew_control.controllers.sliding.design_model import Mask, inverse, observer_step
from flexslew_control.controllers.sliding.sliding_surface import LinearSystem, SlidingDesign
from flexslew_control.law import Estimate, Reference
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.measurement import Measurement


def _cross(a: Vector, b: Vector) -> Vector:
    """Return a x b, shape (3,): a tenth of the time of NumPy's for arrays of any shape."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


class PlatformCoupling(NamedTuple):
    """How the platform's motion moves an appendage, and the platform's own numbers.

    Args:
        torque: platform torque of each joint's effort, shape (3, joints).
        inertia: of the whole about the body origin, shape (3, 3).
        tangential: C^T, modal force of -angular acceleration, shape (n, 3).
        centrifugal: D_j / 2 for w^T (D_j / 2) w, shape (n, 3, 3).
        mass: modal masses, shape (n,).
    """

    torque: Matrix
    inertia: Matrix
    tangential: Matrix
    centrifugal: Matrix
    mass: Vector


@dataclass
class OneAppendage:
    """z = (q, q') of one appendage relative to the platform (41), apart from the platform's.

    q'' + C q' + K q = Psi^T u - D(t): the known disturbance D (tangential and centrifugal forces)
    is that of the reference's motion.

    Args:
        system: A, B and C of the appendage clamped to the platform.
        gain: K_f.
        carried: how the platform's motion enters.
        known: whether D is known to law and observer (tracking (a)).
        elastic: False holds the appendage straight.
        period: one tick [s].
        first: where its modes begin among the reference's.
        joints: which of the bench's joints are its efforts, shape (m,).
        count: of the bench's joints.
        rows: which tip readings are its displacements and rates, shape (l,).
        stiffness, damping: of the platform's feedback, one per joint, shape (joints,).
    """

    system: LinearSystem
    gain: Matrix
    carried: PlatformCoupling
    known: bool
    elastic: bool
    period: float
    first: int
    joints: list[int]
    count: int
    rows: list[int]
    stiffness: Vector
    damping: Vector
    _step: Matrix = field(init=False)
    _effectiveness: Matrix | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Precompute what does not change."""
        k = len(self.system.a)
        # one column more per state: a disturbance that is held
        augmented = replace(self.system, b=np.hstack((self.system.b, np.eye(k))))
        self._step = observer_step(augmented, self.gain, self.period)
        self._inverse = np.linalg.inv(self.carried.inertia)
        self._to_spin = np.linalg.pinv(self.carried.torque.T)
        self._none = np.zeros(k)
        self._appendage_joints = np.zeros(self.count, dtype=bool)
        self._appendage_joints[self.joints] = True

    @property
    def joint_rows(self) -> Mask:
        """None of its states is a joint of the bench."""
        return np.zeros(len(self.system.a), dtype=bool)

    def start(self, measurement: Measurement) -> Vector:
        """Return a straight appendage at rest."""
        return np.zeros(len(self.system.a))

    def outputs(self, measurement: Measurement) -> Vector:
        """Return the tip's displacements and rates."""
        return measurement.tip_deflection[self.rows]

    def efforts(self, measurement: Measurement) -> Vector:
        """Return the torques at its tip."""
        return measurement.applied_effort[self.joints]

    def disturbance(self, reference: Reference | None) -> Vector:
        """Return D(t) in the rows of q'', from the torque that the plan feeds forward."""
        if reference is None or not self.known:
            return self._none
        c = self.carried
        spin = self._to_spin @ reference.velocity
        torque = c.torque @ reference.effort
        acceleration = self._inverse @ (torque - _cross(spin, c.inertia @ spin))
        force = (c.centrifugal @ spin) @ spin - c.tangential @ acceleration
        return np.concatenate((np.zeros(force.size), force / c.mass))

    def linear_observer(self, outputs: int, references: list[Reference]) -> LinearObserver:
        """Return `advanced` as matrices, for so many outputs of the bench, tick by tick."""
        k, m, first = len(self.system.a), len(self.joints), 2 * self.count
        effort, before = np.zeros((k, self.count)), np.zeros((k, outputs))
        effort[:, self.joints] = self._step[:, k : k + m]
        before[:, [first + row for row in self.rows]] = self._step[:, k + m + k :]
        known = np.array([self.disturbance(reference) for reference in references])
        disturbance = known @ self._step[:, k + m : k + m + k].T
        return LinearObserver(
            np.zeros((k, outputs)), self._step[:, :k], effort, before, disturbance
        )

    def propagate(
        self, z: Vector, y: Vector, effort: Vector, gain: Matrix, reference: Reference | None
    ) -> Vector:
        """Return z one tick later, exactly for what is held."""
        disturbance = self.disturbance(reference)
        return self._step @ np.concatenate((z, effort, disturbance, y))

    def error_step(self) -> tuple[Matrix, Matrix]:
        """Return what a tick makes of errors and of held sensor noise."""
        return self._step[:, : len(self.system.a)], self._step[:, -len(self.system.c) :]

    def drift(self, z: Vector, reference: Reference) -> Vector:
        """Return A z + D."""
        return self.system.a @ z + self.disturbance(reference)

    def effectiveness(self, z: Vector, surface: Matrix) -> Matrix:
        """Return (G B)^-1."""
        if self._effectiveness is None:
            self._effectiveness = inverse(surface @ self.system.b)
        return self._effectiveness

    def nominal_state(self, reference: Reference) -> tuple[Vector, Vector]:
        """Return z* and z*' at the tick: the modes of the plan's model, the rest zero."""
        n = len(self.system.a) // 2
        if not self.elastic or not reference.state.size:
            return self._none, self._none
        now, later = self._modes(reference.state, n), self._modes(reference.next_state, n)
        q, v = now[:n], now[n:]
        # the cubic through both ends and slopes: its second derivative at the tick
        h = self.period
        slope = 6.0 * (later[:n] - q) / h**2 - (4.0 * v + 2.0 * later[n:]) / h
        return now, np.concatenate((v, slope))

    def _modes(self, state: Vector, n: int) -> Vector:
        """Return this appendage's modes and rates of a plan's state [joint, modes, rates]."""
        half = state.size // 2
        kept = min(n, half - 1 - self.first)
        out = np.zeros(2 * n)
        at = 1 + self.first
        out[:kept] = state[at : at + kept]
        out[n : n + kept] = state[half + at : half + at + kept]
        return out

    def on_bench(self, effort: Vector) -> Vector:
        """Return the torques at the tip in their places, others zero."""
        out = np.zeros(self.count)
        out[self.joints] = effort
        return out

    def platform(self, measurement: Measurement, reference: Reference) -> dict[str, Vector]:
        """Return the plan's efforts on the platform and the feedback of its pose."""
        position = self.stiffness * (reference.position - measurement.joint_position)
        rate = self.damping * (reference.velocity - measurement.joint_velocity)
        return {
            "zero_order": np.where(self._appendage_joints, 0.0, reference.effort),
            "attitude": np.where(self._appendage_joints, 0.0, position),
            "attitude_rate": np.where(self._appendage_joints, 0.0, rate),
        }

    def estimate(self, z: Vector, measurement: Measurement) -> tuple[Vector, Vector]:
        """Return the joints as measured and the estimated modes."""
        n = len(z) // 2
        return (
            np.concatenate((measurement.joint_position, z[:n])),
            np.concatenate((measurement.joint_velocity, z[n:])),
        )

    def state(self, estimate: Estimate) -> Vector:
        """Return the modes and their rates."""
        n = len(self.system.a) // 2
        return np.concatenate((estimate.position[-n:], estimate.velocity[-n:]))


def appendage_form(
    found: SlidingDesign, observed: OneAppendage, kappa: float, references: list[Reference]
) -> LinearForm:
    """Return the sliding law of one appendage as matrices; see LawEntry.

    Args:
        found: G, K_f and nu.
        observed: what is controlled.
        kappa: on the joints' rows [1/s].
        references: tick by tick.
    """
    system, surface, count = observed.system, found.surface, observed.count
    g_b = observed.effectiveness(np.zeros(len(system.a)), surface)
    reaching = g_b @ (surface * (found.reaching_rate + kappa * observed.joint_rows))
    innovation = g_b @ surface @ found.observer_gain
    place = np.eye(count)[:, observed.joints]
    pairs = [observed.nominal_state(reference) for reference in references]
    nominal, slope = (np.array(column) for column in zip(*pairs, strict=True))
    known = np.array([observed.disturbance(reference) for reference in references])
    mask = np.isin(np.arange(count), observed.joints)
    plan_efforts = np.array([np.where(mask, 0.0, reference.effort) for reference in references])
    demand = plan_efforts + ((slope - known) @ (g_b @ surface).T + nominal @ reaching.T) @ place.T
    of_state = innovation @ system.c - g_b @ surface @ system.a - reaching
    of_output = np.zeros((count, 2 * count + 1 + max(observed.rows)))
    of_output[:, [2 * count + row for row in observed.rows]] = place @ -innovation
    observer = observed.linear_observer(of_output.shape[1], references)
    gains = np.where(mask, 0.0, observed.stiffness), np.where(mask, 0.0, observed.damping)
    return observed_form(place @ of_state, of_output, demand, observer, gains)
