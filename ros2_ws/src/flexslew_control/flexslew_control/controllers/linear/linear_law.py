"""Any linear time-invariant controller: x(k + 1) = A x + B w, u = u_ff + C x + D w, from a file.

w are signals by name; see SIGNALS. A continuous one is discretised at the bench's period.
"""

from typing import Literal

import numpy as np

from flexslew_control.analysis.linear_plant import PlantPath, sampled_plant
from flexslew_control.analysis.loop import loop_of, unstable_poles
from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.rest import rest_of
from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.linear_form import (
    LinearForm,
    LinearObserver,
    no_integral,
    observed_form,
)
from flexslew_control.law import (
    Estimate,
    Estimator,
    Law,
    MeasuredJoints,
    PlantDescription,
    Reference,
)
from flexslew_control.linear.design_checks import OperatingPoint
from flexslew_control.shared_keys import DesignModel, TrackingTime
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import Positive, section
from flexslew_plant.state_space import StateSpace, matrices
from flexslew_plant.system_file import system_from_file
from flexslew_plant.testbeds import design_testbed
from flexslew_plant.testbeds.integration_error import steps_per_tick
from flexslew_plant.testbeds.model import Model

# of joints, then of appendages; error is the reference minus what is measured
SIGNALS = ("error", "error_rate", "position", "rate", "reference", "reference_rate", "applied",
           "tip", "curvature")  # fmt: skip
_OF_APPENDAGES = ("tip", "curvature")
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


class LinearLaw:
    """u = sat(u_ff + C x + D w), x+ = A x + B w + C^+ (sat(u) - u) h / T_t.

    Args:
        system: discrete, from `raw` signals to all joints: see _folded.
        limit: of the efforts, shape (joints,).
        tracking_gain: C^+ h / T_t, shape (states, joints).
        feedforward: whether the plan's effort is added.
    """

    def __init__(
        self, system: Lti, limit: Vector, tracking_gain: Matrix, feedforward: bool
    ) -> None:
        self.system, self.limit, self.back, self.feedforward = (
            system,
            limit,
            tracking_gain,
            feedforward,
        )
        self._n, self._bounds = len(system.a), limit.tolist()
        self._map = np.block([[system.a, system.b], [system.c, system.d]])
        self._inverse = np.linalg.pinv(system.c)
        self._x = np.zeros(self._n)
        self._none = np.zeros(limit.size)
        self.terms: dict[str, Vector] = {}

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Choose the smallest state such that the next effort is `effort`; at tick 0 it is zero."""
        self._x = np.zeros(self._n)
        if measurement.tick > 0 and self._n:
            feedback = self._map[self._n :] @ self._raw(measurement, reference)
            self._x = self._inverse @ (effort - feedback - self._feedforward(reference))

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts within the limit, shape (joints,) [N m or N]."""
        out = self._map @ self._raw(measurement, reference)
        n, feedforward = self._n, self._feedforward(reference)
        self._x, feedback = out[:n], out[n:]
        demand = feedforward + feedback
        self.terms = {"feedforward": feedforward, "linear": feedback}
        if all(-b <= u <= b for u, b in zip(demand.tolist(), self._bounds, strict=True)):
            return demand
        effort = np.clip(demand, -self.limit, self.limit)
        self._x = self._x + self.back @ (effort - demand)
        return effort

    def _feedforward(self, reference: Reference) -> Vector:
        return reference.effort if self.feedforward else self._none

    def _raw(self, m: Measurement, r: Reference) -> Vector:
        return np.concatenate(
            (self._x, m.joint_position, m.joint_velocity, m.tip_deflection, m.root_curvature,
             m.applied_effort, r.position, r.velocity)
        )  # fmt: skip


def build(settings: LinearSettings, plant: PlantDescription) -> tuple[Estimator, Law]:
    """Return the estimator, which gives the measured joints, and the law.

    Raises:
        BadInput: if shapes, signals or period do not fit the bench, the loop is not stable on its
            design model, or its anti-windup runs away.
    """
    model = plant.testbed.model()
    system = _folded(settings, model, plant.period)
    m, limit = len(plant.joint_names), plant.effort_limit
    share = 0.0 if settings.tracking_time is None else plant.period / settings.tracking_time
    tracking_gain = np.asarray(share * np.linalg.pinv(system.c).reshape(-1, m), dtype=np.float64)
    _require_stable_tracking(settings, system, tracking_gain)
    law = LinearLaw(system, limit, tracking_gain, settings.feedforward)
    if settings.system is not None and not settings.allow_unstable:
        _require_stable(settings, plant, system)
    return MeasuredJoints(), law


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


def _folded(settings: LinearSettings, model: Model, period: float) -> Lti:
    """Return the discrete system from [q, q', tips, curvatures, applied, q_d, q_d'] to all joints.

    Raises:
        BadInput: see build.
    """
    joints, appendages = model.joint_names, model.appendages.names
    raw = raw_signals(joints, appendages)
    m, given = len(joints), settings.system or StateSpace()
    inputs = given.inputs or _default_inputs(given, joints)
    outputs = given.outputs or joints
    a, b, c, d = matrices(given, len(inputs), len(outputs))
    if given.period and abs(given.period - period) > 1e-9 * period:
        raise BadInput(
            f"system.period: {given.period:g} s is not allowed: the bench ticks every {period:g} s;"
            " give a continuous system (0), or one of this period"
        )
    if not given.period and len(a):
        a, b, c, d = to_discrete(settings, a, b, c, d, period)
    pick = np.array([_row(name, raw, joints, appendages) for name in inputs])
    place = np.zeros((m, len(outputs)))
    for k, name in enumerate(outputs):
        joint = name.removeprefix("effort.")
        if joint not in joints:
            allowed = ", ".join(f"effort.{known}" for known in joints)
            raise BadInput(f"system.outputs: {name} is not allowed: {allowed}")
        if place[joints.index(joint)].any():
            raise BadInput(f"system.outputs: {name} is there twice; give each joint one output")
        place[joints.index(joint), k] = 1.0
    pick = pick.reshape(len(inputs), len(raw))
    states = tuple(f"x.{k + 1}" for k in range(len(a)))
    efforts = tuple(f"effort.{joint}" for joint in joints)
    return Lti(a, b @ pick, place @ c, place @ d @ pick, raw, efforts, states, period)


def raw_signals(joints: tuple[str, ...], appendages: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the inputs at a tick, in their order."""
    of = {"position": joints, "rate": joints, "tip": appendages, "curvature": appendages,
          "applied": joints, "reference": joints, "reference_rate": joints}  # fmt: skip
    return tuple(f"{kind}.{name}" for kind, names in of.items() for name in names)


def _default_inputs(given: StateSpace, joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the inputs of a system that names none."""
    rows = given.b or given.d or ()
    errors = tuple(f"error.{joint}" for joint in joints)
    rates = tuple(f"error_rate.{joint}" for joint in joints)
    count = len(rows[0]) if rows else 0
    return (errors + rates)[:count] if count in (0, len(joints), 2 * len(joints)) else errors


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


def _row(
    name: str, raw: tuple[str, ...], joints: tuple[str, ...], appendages: tuple[str, ...]
) -> Vector:
    """Return an input as a row over the raw signals."""
    kind, _, of = name.partition(".")
    known = appendages if kind in _OF_APPENDAGES else joints
    if kind not in SIGNALS or of not in known:
        allowed = [f"{k}.{n}" for k in SIGNALS for n in
                 (appendages if k in _OF_APPENDAGES else joints)]  # fmt: skip
        raise BadInput(f"system.inputs: {name} is not allowed: {', '.join(allowed)}")
    row = np.zeros(len(raw))
    if kind in ("error", "error_rate"):
        rate = "_rate" if kind == "error_rate" else ""
        row[raw.index(f"reference{rate}.{of}")] = 1.0
        row[raw.index(f"{'rate' if rate else 'position'}.{of}")] = -1.0
    else:
        row[raw.index(name)] = 1.0
    return row


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


def linear(estimator: Estimator, law: LinearLaw, references: list[Reference]) -> LinearForm | None:
    """Return the law as matrices; see LawEntry. None: it listens to what batches do not know.

    x(k) is split into what the references do, known beforehand, and an observer of the rest with
    A - back C, driven by its own demand within the limit: the anti-windup is in it.
    """
    s, m = law.system, law.limit.size
    kinds = [name.partition(".")[0] for name in s.inputs]
    used = [bool(s.b[:, k].any() or s.d[:, k].any()) for k in range(len(kinds))]
    tips = [k for k, kind in enumerate(kinds) if kind == "tip"]
    known = (
        set(range(2 * m))
        | set(tips[:1])
        | {k for k, kind in enumerate(kinds) if kind.startswith("reference")}
    )
    if any(use and k not in known for k, use in enumerate(used)):
        return None
    y = [*range(2 * m), *(tips[:1] if tips and used[tips[0]] else ())]
    r = [k for k, kind in enumerate(kinds) if kind.startswith("reference")]
    a, b = s.a - law.back @ s.c, s.b - law.back @ s.d
    x, demand = np.zeros(len(a)), []
    for one in references:
        w = np.concatenate((one.position, one.velocity))
        feedforward = one.effort if law.feedforward else np.zeros(m)
        demand.append(feedforward + s.c @ x + s.d[:, r] @ w)
        x = a @ x + b[:, r] @ w - law.back @ feedforward
    n = len(a)
    start, no_effort = np.zeros((n, len(y))), np.zeros((n, m))
    observer = LinearObserver(start, a, no_effort, b[:, y], np.zeros(n), law.back)
    form = observed_form(s.c, s.d[:, y], np.array(demand), observer)
    integration = no_integral(m)._replace(limit=law.limit)
    return form._replace(law=form.law._replace(integration=integration))


LINEAR = LawEntry("linear", LinearSettings, build, linear=linear, from_file=system_from_file)
