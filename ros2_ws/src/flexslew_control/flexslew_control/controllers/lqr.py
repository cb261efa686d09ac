"""Linear quadratic regulator with disturbance minimisation (Kwak 1989, (3-1) to (3-10))."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import LinAlgError

from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.linear_form import (
    LinearForm,
    OnDeviation,
    no_integral,
    nominal_form,
)
from flexslew_control.controllers.rotation_form import rotation_form
from flexslew_control.controllers.sampled_loop import integral_loop, require_sampled_stability
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter
from flexslew_control.estimators.rotation_filter import RotationFilter, rotation_filter
from flexslew_control.law import Estimate, LawFailed, PlantDescription, Reference
from flexslew_control.linear.design_checks import (
    LinearDesignModel,
    OperatingPoint,
    operating_point_of,
    require_controllable,
    state_names,
)
from flexslew_control.linear.free_platform import LinearModel, joints_first, nominal
from flexslew_control.linear.rate_dependent_platform import (
    RateDependentPlatform,
    rate_dependent_platform,
)
from flexslew_control.linear.riccati import continuous_riccati
from flexslew_control.shared_keys import DesignModel
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.linearisation import Linearisation

_POINTS = 1.0  # between two points of a plan at which its gains are computed [s]


@section
class ScaledWeights:
    """Q and R in scaled units: joints in rad (or m), deflections in `deflection`, time in `time`.

    An effort counts in J_jj / time^2, J_jj the joint's inertia at the operating point.
    """

    joint: NonNegative = 100.0  # weight of each joint position [-]
    mode: NonNegative = 1000.0  # weight of each modal coordinate [-]
    joint_rate: NonNegative = 100.0  # weight of each joint rate [-]
    mode_rate: NonNegative = 1000.0  # weight of each modal rate [-]
    effort: Positive = 1.0  # weight of each effort (of its rate in the PI law) [-]
    time: Positive = 8.0  # time scale T_0 [s]
    deflection: Positive = 31.0  # scale of the deflections [m]


@dataclass(frozen=True)
class ScaledProblem:
    """The regulator's problem in SI units, from weights in scaled units.

    Args:
        a, b: of x' = A x + B u, x = [q, v], shapes (2 n, 2 n), (2 n, m).
        q: weight on x, shape (2 n, 2 n).
        effort_weight: weight on u, shape (m, m).
        effort_scale: what one scaled effort is, shape (m,) [N m or N].
        time: what one scaled time is [s].
    """

    a: Matrix
    b: Matrix
    q: Matrix
    effort_weight: Matrix
    effort_scale: Vector
    time: float


def scaled_problem(linear: Linearisation, weights: ScaledWeights) -> ScaledProblem:
    """Return A, B and the weights in SI units: Q = S^-1 Qhat S^-1, R = S_u^-1 Rhat S_u^-1.

    Args:
        linear: the small motions about the operating point.
        weights: in scaled units.
    """
    n, m = linear.input_matrix.shape
    w = weights
    size = np.array([1.0] * m + [w.deflection] * (n - m))
    scale = np.concatenate((size, size / w.time))
    position = [w.joint] * m + [w.mode] * (n - m)
    rate = [w.joint_rate] * m + [w.mode_rate] * (n - m)
    # a wheel's turn of the platform is a small part of its own turn, so its B is not 1
    inertia = np.diag(linear.mass)[:m] / np.diag(linear.input_matrix)[:m]
    effort_scale = inertia / w.time**2
    return ScaledProblem(
        linear.state_matrix,
        linear.state_input_matrix,
        np.diag(np.array(position + rate) / scale**2),
        np.diag(w.effort / effort_scale**2),
        effort_scale,
        w.time,
    )


def regulator(a: Matrix, b: Matrix, q: Matrix, r: Matrix) -> tuple[Matrix, Matrix]:
    """Return K = R^-1 B^T P and P of the stationary Riccati equation (3-8), (3-9a).

    0 = P A + A^T P + Q - P B R^-1 B^T P.

    Args:
        a: state matrix, shape (k, k).
        b: input matrix, shape (k, m).
        q: weights of the states, shape (k, k).
        r: weights of the efforts, shape (m, m).

    Raises:
        BadInput: there is no stabilising solution.
    """
    try:
        p = continuous_riccati(a, b, q, r)
    except LinAlgError as error:
        raise BadInput(f"no optimal regulator: {error}; weigh every mode") from None
    gain = np.linalg.solve(r, b.T @ p)
    return np.asarray(gain, dtype=np.float64), p


def disturbance_gain(input_matrix: Matrix) -> Matrix:
    """Return (B*)^+ = (B*^T B*)^-1 B*^T (3-5); f = -(B*)^+ d minimises |d + B* f|.

    Args:
        input_matrix: B*, from efforts to generalised forces, shape (n, m).
    """
    gain = np.linalg.solve(input_matrix.T @ input_matrix, input_matrix.T)
    return np.asarray(gain, dtype=np.float64)


@section
class Lqr:
    """Linear quadratic regulator on a Kalman filter that also cancels the disturbance."""

    model: DesignModel = None
    operating_point: OperatingPoint = None
    weights: ScaledWeights = ScaledWeights()  # weights of the quadratic criterion
    filter: FilterSettings = FilterSettings()  # the Kalman filter
    # whether the estimated disturbance is cancelled, eqs (3) and (4)
    minimise_disturbance: bool = True


class GainSchedule:
    """K(w) of the regulator about the rates of a plan, at points of it and linear between them.

    At each point K is of the stationary equation (3-8) with A about the rates there.

    Args:
        platform: the small motions about any rates.
        problem: at rest.
        ticks: between two points.
    """

    def __init__(self, platform: RateDependentPlatform, problem: ScaledProblem, ticks: int) -> None:
        self._platform, self._problem, self._ticks = platform, problem, ticks
        self._gain_cache: dict[bytes, Matrix] = {}  # of the last two points

    def about(self, rates: Vector) -> Matrix:
        """Return K about these rates of the joints, shape (joints, 2 n).

        Raises:
            LawFailed: there is none.
        """
        key = rates.tobytes()
        if key not in self._gain_cache:
            p = self._problem
            try:
                gain, _ = regulator(self._platform.state_matrix(rates), p.b, p.q, p.effort_weight)
            except BadInput as error:
                raise LawFailed(f"at rates {np.round(rates, 4).tolist()}: {error}") from None
            self._gain_cache = {**dict(list(self._gain_cache.items())[-1:]), key: gain}
        return self._gain_cache[key]

    def at(self, reference: Callable[[int], Reference], tick: int) -> Matrix:
        """Return K at a tick of a plan, shape (joints, 2 n)."""
        before = tick - tick % self._ticks
        first, then = (self.about(reference(at).velocity) for at in (before, before + self._ticks))
        share = (tick - before) / self._ticks
        return first if first is then else (1.0 - share) * first + share * then


@dataclass
class LqrLaw:
    """u = u_ff - (B*)^+ d_hat - K (x_hat - x*): (3-1) about the nominal trajectory.

    Args:
        model: for the sizes.
        gain: K at rest, shape (joints, 2 n).
        disturbance_gain: (B*)^+ D on the disturbances of the joints, shape (joints, joints).
        schedule: of K along a plan; None: it is that at rest.
    """

    model: LinearDesignModel
    gain: Matrix
    disturbance_gain: Matrix
    schedule: GainSchedule | None = None
    terms: dict[str, Vector] = field(init=False, default_factory=dict)
    _now: Matrix | None = field(init=False, default=None)  # K of the coming answer

    def foresee(self, reference: Callable[[int], Reference], tick: int) -> None:
        """Look up the rates of the plan, where K depends on them."""
        if self.schedule is not None:
            self._now = self.schedule.at(reference, tick)

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Nothing to choose: the law has no state of its own."""

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts, shape (joints,) [N m or N]."""
        gain, self._now = self.gain if self._now is None else self._now, None
        deviation = np.concatenate((estimate.position, estimate.velocity))
        deviation = deviation - nominal(self.model, reference)
        feedback = -(gain @ deviation)
        disturbance_term = -(self.disturbance_gain @ estimate.disturbance)
        self.terms = {
            "feedforward": reference.effort,
            "regulator": feedback,
            "disturbance": disturbance_term,
        }
        return reference.effort + feedback + disturbance_term


def build(settings: Lqr, plant: PlantDescription) -> tuple[KalmanFilter | RotationFilter, LqrLaw]:
    """Return the filter and the law; the drive limits the effort.

    Raises:
        BadInput: a mode is not controllable or not observable, or the weights give no regulator.
    """
    design_model = plant.design_model(settings.model)
    at = operating_point_of(plant, design_model, settings.operating_point)
    platform = rate_dependent_platform(design_model, at)
    model = joints_first(design_model, at) if platform is None else platform.small
    rest = operating_point_of(plant, model, settings.operating_point)
    linear = model.linearise(rest)
    problem = scaled_problem(linear, settings.weights)
    require_controllable(problem.a, problem.b, state_names(model))
    gain, _ = regulator(problem.a, problem.b, problem.q, problem.effort_weight)
    if isinstance(model, LinearModel):
        n = model.coordinates
        require_sampled_stability(
            lambda h: integral_loop(linear, gain[:, :n], gain[:, n:], None, h),
            plant.period,
            "lqr",
        )
    b = linear.input_matrix
    cancel = (
        disturbance_gain(b) @ b if settings.minimise_disturbance else np.zeros((b.shape[1],) * 2)
    )
    if platform is None:
        return KalmanFilter(model, rest, settings.filter, plant.period), LqrLaw(model, gain, cancel)
    schedule = GainSchedule(platform, problem, max(1, round(_POINTS / plant.period)))
    estimator = rotation_filter(platform, settings.filter, plant)
    return estimator, LqrLaw(model, gain, cancel, schedule)


def linear(
    estimator: KalmanFilter | RotationFilter, law: LqrLaw, references: list[Reference]
) -> LinearForm | None:
    """Return the law as matrices; see LawEntry. None: its gains are not all known."""
    if isinstance(estimator, RotationFilter):
        assert law.schedule is not None
        if references[-1].velocity.any():  # those after the run lead to its last gains
            return None
        try:
            each = [law.schedule.at(_of(references), k) for k in range(len(references))]
        except LawFailed:
            return None
        by_tick = np.array(each)
        cancel = np.broadcast_to(law.disturbance_gain, (len(by_tick), *law.disturbance_gain.shape))
        return rotation_form(estimator, -np.concatenate((by_tick, cancel), axis=2), references)
    m, n = law.gain.shape[0], law.gain.shape[1] // 2
    gains = OnDeviation(law.gain, law.disturbance_gain, np.zeros((m, n)))
    return nominal_form(estimator, gains, references, no_integral(m))


def _of(references: list[Reference]) -> Callable[[int], Reference]:
    """Return what gives the reference of a tick; after the last one it rests there."""
    return lambda tick: references[min(tick, len(references) - 1)]


LQR = LawEntry("lqr", Lqr, build, linear=linear, takes_over=True)
