"""Any linear time-invariant controller: x(k + 1) = A x + B w, u = u_ff + C x + D w, from a file.

w are signals by name; see law_signals. A continuous one is discretised at the bench's period.
"""

from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.allocation import Allocation, AllocationLaw
from flexslew_control.analysis.linear_plant import PlantPath, sampled_plant
from flexslew_control.analysis.loop import loop_of, unstable_poles
from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.rest import rest_of
from flexslew_control.controllers.by_joint.gyroscopic import Gyroscopic
from flexslew_control.controllers.by_joint.three_axes import OF_TESTBED, control_axes, form_on_axes
from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.linear.law_signals import LawSignals, on_joints
from flexslew_control.controllers.linear_form import (
    LinearForm,
    LinearObserver,
    no_integral,
    observed_form,
)
from flexslew_control.estimators.attitude_estimator import (
    AttitudeFilterSettings,
    joint_estimator,
)
from flexslew_control.law import Estimate, Estimator, Law, PlantDescription, Reference
from flexslew_control.linear.design_checks import OperatingPoint
from flexslew_control.shared_keys import DesignModel, TrackingTime
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import Positive, section
from flexslew_plant.state_space import StateSpace
from flexslew_plant.system_file import system_from_file
from flexslew_plant.testbeds import design_testbed
from flexslew_plant.testbeds.integration_error import steps_per_tick

_CLOSE = 1e-6  # above one: rounding of a motion that nothing holds
_TRACKING_TIMES = 10.0  # time constants of the anti-windup in which a state may grow e-fold


@section
class LinearSettings:
    """Any linear time-invariant controller, from python-control, MATLAB or a file."""

    system: StateSpace | None = None  # the matrices; null: the plan's feedforward alone
    # tustin or hold, how a continuous system is discretised at the bench's period
    method: Literal["tustin", "hold"] = "tustin"
    prewarping: Positive | None = None  # where Tustin's method is exact [rad/s]; null: at zero
    tracking_time: TrackingTime = 2.0
    feedforward: bool = True  # whether the plan's effort is added
    model: DesignModel = None
    operating_point: OperatingPoint = None
    allow_unstable: bool = False  # fly it though the loop is not stable on that model
    gyroscopic: bool = False  # add w x J w, beyond that of the plan, of a craft in three axes
    # attitude and rates by gyro and star tracker; null: as the joints read them
    attitude: AttitudeFilterSettings | None = None
    # share the torque about the body axes, which the signals are then of, out among thrusters,
    # wheels or gyros; null: its signals are those of the joints
    allocation: Allocation | None = None


class LinearLaw:
    """u = sat(u_ff + C x + D w), x+ = A x + B w + C^+ (sat(u) - u) h / T_t.

    Its axes are the joints, or the body axes behind an AllocationLaw.

    Args:
        system: discrete, from the raw signals to all axes: see LawSignals.
        limit: of the efforts, shape (axes,) [N m or N]; None: none.
        tracking_gain: C^+ h / T_t, shape (states, axes).
        feedforward: whether the plan's effort is added.
        turning: adds w x J w beyond that of the reference to u; None: nothing.
    """

    def __init__(
        self, system: Lti, limit: Vector | None, tracking_gain: Matrix, feedforward: bool,
        turning: Gyroscopic | None = None,
    ) -> None:  # fmt: skip
        self.system, self.limit, self.back, self.feedforward = (
            system,
            limit,
            tracking_gain,
            feedforward,
        )
        self.turning = turning
        self.axes, self._n = len(system.c), len(system.a)
        self._bounds = [] if limit is None else limit.tolist()
        self._map = np.block([[system.a, system.b], [system.c, system.d]])
        self._inverse = np.linalg.pinv(system.c)
        self._x = np.zeros(self._n)
        self._none = np.zeros(self.axes)
        self.terms: dict[str, Vector] = {}

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Choose the smallest state such that the next effort is `effort`; at tick 0 it is zero."""
        self._x = np.zeros(self._n)
        if measurement.tick > 0 and self._n:
            feedback = self._map[self._n :] @ self._raw(measurement, estimate, reference)
            others = self._feedforward(reference)
            if self.turning is not None:
                others = others + self._gyroscopic_excess(self.turning, estimate, reference)
            self._x = self._inverse @ (effort - feedback - others)

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the efforts within the limit, shape (axes,) [N m or N]."""
        out = self._map @ self._raw(measurement, estimate, reference)
        n, feedforward = self._n, self._feedforward(reference)
        self._x, feedback = out[:n], out[n:]
        demand = feedforward + feedback
        self.terms = {"feedforward": feedforward, "linear": feedback}
        if self.turning is not None:
            excess = self._gyroscopic_excess(self.turning, estimate, reference)
            self.terms["gyroscopic"] = excess
            demand = demand + excess
        within = all(-b <= u <= b for u, b in zip(demand.tolist(), self._bounds, strict=False))
        if self.limit is None or within:
            return demand
        effort = np.clip(demand, -self.limit, self.limit)
        self._x = self._x + self.back @ (effort - demand)
        return effort

    def _feedforward(self, reference: Reference) -> Vector:
        return reference.effort if self.feedforward else self._none

    def _gyroscopic_excess(
        self, gyro_torque: Gyroscopic, estimate: Estimate, reference: Reference
    ) -> Vector:
        return gyro_torque.limit_excess(estimate.velocity[: self.axes], reference.velocity)

    def _raw(self, m: Measurement, e: Estimate, r: Reference) -> Vector:
        k = self.axes
        return np.concatenate(
            (self._x, e.position[:k], e.velocity[:k], m.tip_deflection, m.root_curvature,
             m.applied_effort, r.position, r.velocity)
        )  # fmt: skip


def build(settings: LinearSettings, plant: PlantDescription) -> tuple[Estimator, Law]:
    """Return the estimator, which gives the joints, and the law.

    Raises:
        BadInput: if shapes, signals or period do not fit the bench, the loop is not stable on its
            design model, its anti-windup runs away, or gyroscopic, attitude or allocation is set
            on a testbed that does not turn in three axes or lacks the sensors.
    """
    what = control_axes(plant, settings.allocation, settings.gyroscopic)
    signals = LawSignals.of(what, plant.testbed.model().appendages.names)
    system = _sampled(settings, signals, plant.period)
    share = 0.0 if settings.tracking_time is None else plant.period / settings.tracking_time
    tracking_gain = np.asarray(
        share * np.linalg.pinv(system.c).reshape(-1, len(what.names)), dtype=np.float64
    )
    _require_stable_tracking(settings, system, tracking_gain)
    # an allocation keeps the direction of a torque that is too large
    unlimited = what.allocator is not None and not tracking_gain.any()
    limit = None if unlimited else what.limit
    law = LinearLaw(system, limit, tracking_gain, settings.feedforward, what.turning)
    if settings.system is not None and not settings.allow_unstable:
        if what.allocator is not None and what.attitude is not None:
            system = on_joints(system, signals, what.allocator, what.attitude)
        _require_stable(settings, plant, system)
    return joint_estimator(plant, settings.attitude), what.finished(law)


def _require_stable_tracking(settings: LinearSettings, system: Lti, tracking_gain: Matrix) -> None:
    """Check that the state settles while an effort is at its limit: there it goes by A - back C.

    Raises:
        BadInput: it grows e-fold within some time constants of the anti-windup, and A does not.
    """
    if settings.tracking_time is None or not len(system.a):
        return
    open_radius, tracking_radius = (
        float(np.abs(np.linalg.eigvals(a)).max())
        for a in (system.a, system.a - tracking_gain @ system.c)
    )
    rate = np.log(tracking_radius / max(open_radius, 1.0)) / system.period  # [1/s]
    if rate * _TRACKING_TIMES * settings.tracking_time > 1.0:
        raise BadInput(
            f"null, or longer: while an effort is at its limit the state would grow "
            f"{np.exp(min(rate, 100.0)):.3g}-fold in a second, as the system has poles that are "
            "fast beside a tick",
            key="tracking_time",
            value=settings.tracking_time,
        )


def _sampled(settings: LinearSettings, signals: LawSignals, period: float) -> Lti:
    """Return the discrete system from the raw signals to all outputs; see LawSignals.

    Raises:
        BadInput: see build.
    """
    given = settings.system or StateSpace()
    parts = signals.matrices_of(given)
    if given.period and abs(given.period - period) > 1e-9 * period:
        raise BadInput(
            f"system.period: {given.period:g} s is not allowed: the bench ticks every {period:g} s;"
            " give a continuous system (0), or one of this period"
        )
    if not given.period and len(parts[0]):
        parts = to_discrete(settings, *parts, period)
    return signals.connected(given, parts, period)


def to_discrete(
    settings: LinearSettings, a: Matrix, b: Matrix, c: Matrix, d: Matrix, period: float
) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return a continuous system at a period: held inputs, or Tustin's method with prewarping.

    SciPy's, as a node that flies must not wait for python-control to load.
    """
    from scipy.signal import cont2discrete  # takes a third of a second

    if settings.method == "hold":
        found = cont2discrete((a, b, c, d), period, "zoh")
    else:
        w = settings.prewarping
        if w is not None and w * period >= np.pi:
            raise BadInput(
                f"prewarping: {w:g} rad/s is not allowed: below {np.pi / period:g}, half the rate"
            )
        step = period if w is None else 2.0 * np.tan(0.5 * w * period) / w
        found = cont2discrete((a, b, c, d), step, "bilinear")
    return tuple(np.asarray(part, dtype=np.float64) for part in found[:4])  # type: ignore[return-value]


def _require_stable(settings: LinearSettings, plant: PlantDescription, system: Lti) -> None:
    """Check the loop on the model that is believed.

    Raises:
        BadInput: it is not stable; gives the spectral radius.
    """
    testbed = design_testbed(plant.testbed, settings.model, "model")
    point = settings.operating_point
    rest = rest_of(testbed, plant.testbed.operating_point if point is None else point)
    poles = rest.model.integrated_poles(rest.q)
    steps = steps_per_tick(poles, plant.period)
    seen = sampled_plant(rest, PlantPath(plant.period, steps=steps), applied=True)
    shared = [name for name in system.inputs if name in seen.outputs or "reference" in name]
    columns = [system.inputs.index(name) for name in shared]
    names = tuple(name for name in shared)
    form = Lti(
        system.a, system.b[:, columns], system.c, system.d[:, columns], names, system.outputs,
        system.states, system.period,
    )  # fmt: skip
    plant_of_loop = seen.rows([name for name in seen.outputs if name in names])
    radius = float(abs(unstable_poles(loop_of(plant_of_loop, form), _CLOSE)).max(initial=0.0))
    if radius:
        raise BadInput(
            f"system: the loop is not stable on the model that it believes: the spectral radius of "
            f"one tick is {radius:.6g}; give another system or model, or allow_unstable: true"
        )


def linear(estimator: Estimator, law: Law, references: list[Reference]) -> LinearForm | None:
    """Return the law as matrices; see LawEntry. None: batches do not know what it reads.

    Or the anti-windup of an allocated torque acts on states.
    """
    attitude = law.attitude if isinstance(law, AllocationLaw) else None
    joints = references[0].position.size

    def form_of(law: Law, wanted: Reference) -> tuple[LinearForm, Gyroscopic | None] | None:
        assert isinstance(law, LinearLaw)
        if attitude is None:
            found = _form(law, wanted, np.eye(joints))
        elif law.back.any():  # what it is held to is a torque, and batches keep efforts
            found = None
        else:
            found = _form(law, wanted, attitude.rotation_vector_of(np.eye(joints)).T)
        return None if found is None else (found, law.turning)

    return form_on_axes(estimator, law, references, form_of)


def _form(law: LinearLaw, wanted: Reference, turn: Matrix) -> LinearForm | None:
    """Return a law as matrices of the measured joints.

    x(k) is split into what the references do, known beforehand, and an observer of the rest with
    A - back C, driven by its own demand within the limit: the anti-windup is in it.

    Args:
        law: on the joints or on body axes.
        wanted: its references, tick by tick in rows.
        turn: from the joints' positions to those of its axes, shape (axes, joints).
    """
    s, m = law.system, law.axes
    kinds = [name.partition(".")[0] for name in s.inputs]
    used = [bool(s.b[:, k].any() or s.d[:, k].any()) for k in range(len(kinds))]
    tips = [k for k, kind in enumerate(kinds) if kind == "tip"]
    r = [k for k, kind in enumerate(kinds) if kind.startswith("reference")]
    known = {*range(2 * m), *tips[:1], *r}
    if any(use and k not in known for k, use in enumerate(used)):
        return None
    if law.turning is not None and law.back.any():
        return None
    tip = tips[:1] if tips and used[tips[0]] else []
    seen = block_diag(turn, turn, np.eye(len(tip)))
    y = [*range(2 * m), *tip]
    a, b = s.a - law.back @ s.c, s.b - law.back @ s.d
    x, demand = np.zeros(len(a)), []
    feedforward = wanted.effort if law.feedforward else 0.0 * wanted.effort
    for k, effort in enumerate(feedforward):
        w = np.concatenate((wanted.position[k], wanted.velocity[k]))
        demand.append(effort + s.c @ x + s.d[:, r] @ w)
        x = a @ x + b[:, r] @ w - law.back @ effort
    n = len(a)
    start, no_effort = np.zeros((n, seen.shape[1])), np.zeros((n, turn.shape[1]))
    tracking = law.back if law.back.any() else np.zeros((0, 0))
    observer = LinearObserver(start, a, no_effort, b[:, y] @ seen, np.zeros(n), tracking)
    form = observed_form(s.c, s.d[:, y] @ seen, np.array(demand), observer)
    integration = no_integral(m)
    if law.limit is not None:
        integration = integration._replace(limit=law.limit)
    return form._replace(law=form.law._replace(integration=integration))


LINEAR = LawEntry(
    "linear",
    LinearSettings,
    build,
    linear=linear,
    of_testbed=OF_TESTBED,
    from_file=system_from_file,
)
