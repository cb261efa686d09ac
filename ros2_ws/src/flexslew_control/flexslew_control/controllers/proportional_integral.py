"""Proportional-plus-integral, disturbance-accommodating control (Kwak 1989, (3-12) to (3-24))."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from flexslew_control.controllers.by_joint.integral_action import Action, IntegralLaw
from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.linear_form import LinearForm, OnDeviation, nominal_form
from flexslew_control.controllers.lqr import ScaledWeights, scaled_problem
from flexslew_control.controllers.rotation_form import IntegralTerm, rotation_form
from flexslew_control.controllers.sampled_loop import integral_loop, require_sampled_stability
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter
from flexslew_control.estimators.rotation_filter import RotationFilter, rotation_filter
from flexslew_control.law import Estimate, PlantDescription, Reference
from flexslew_control.linear.design_checks import (
    LinearDesignModel,
    OperatingPoint,
    operating_point_of,
    require_controllable,
    require_stable,
    state_names,
)
from flexslew_control.linear.free_platform import LinearModel, joints_first, nominal
from flexslew_control.linear.rate_dependent_platform import rate_dependent_platform
from flexslew_control.linear.riccati import continuous_riccati
from flexslew_control.shared_keys import DesignModel, TrackingTime
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import section
from flexslew_plant.testbeds.linearisation import Linearisation

Rows: TypeAlias = tuple[tuple[float, ...], ...]


@section
class GivenGains:
    """Gains by hand instead of the design: one row per joint, one column per coordinate."""

    kp: Rows  # proportional gains, one row per joint [N m/rad, N m/m]
    kd: Rows  # derivative gains, one row per joint [N m s/rad, N m s/m]
    ki: Rows  # integral gains, one row per joint [N m/(rad s), N m/(m s)]


@section
class ProportionalIntegral:
    """Proportional-integral control of the estimated state that rejects disturbances."""

    model: DesignModel = None
    operating_point: OperatingPoint = None
    weights: ScaledWeights = ScaledWeights()  # weights of the quadratic criterion
    gains: GivenGains | None = None  # gains as below; null: designed from the weights
    tracking_time: TrackingTime = 2.0
    filter: FilterSettings = FilterSettings()  # the Kalman filter


@dataclass(frozen=True)
class PiGains:
    """tau = -Kp e - Kd e' - integral of Ki e, each of shape (joints, n).

    `design_poles` are those of the augmented regulator, which the closed loop has too;
    empty where the gains were given by hand.
    """

    kp: Matrix
    kd: Matrix
    ki: Matrix
    design_poles: NDArray[np.complex128]


def design(linear: Linearisation, weights: ScaledWeights) -> PiGains:
    """Return the gains of the regulator for z = (x, u), u' its input (3-16) to (3-24).

    u' = G1 x + G2 u; with the left inverse B^L = [0, D^L M] of B, D^L = (D^T D)^-1 D^T (momentum
    in place of the pseudo-inverse), f = Gp x + Gi integral(x), Gp = G2 B^L, Gi = G1 - G2 B^L A.
    Gp has rates only, so Kd = -Gp; the integral of the rates is the displacement, so Kp is the
    rate block of -Gi and Ki its displacement block. The equation is solved in scaled units.

    Args:
        linear: the small motions about the operating point.
        weights: in scaled units; `effort` weighs u' too.

    Raises:
        BadInput: the augmented system has no stabilising regulator.
    """
    n, m = linear.input_matrix.shape
    p = scaled_problem(linear, weights)
    augmented = np.zeros((2 * n + m, 2 * n + m))
    augmented[: 2 * n, : 2 * n], augmented[: 2 * n, 2 * n :] = p.a, p.b
    inputs = np.eye(2 * n + m)[:, 2 * n :]
    state_weight = np.zeros_like(augmented)
    state_weight[: 2 * n, : 2 * n], state_weight[2 * n :, 2 * n :] = p.q, p.effort_weight
    size = np.concatenate((np.sqrt(np.diag(p.q)), 1.0 / p.effort_scale))
    size[size == 0.0] = 1.0
    scale = np.diag(1.0 / size)  # z = scale times its scaled value
    input_scale = np.diag(p.effort_scale / p.time)
    a = p.time * np.asarray(np.linalg.solve(scale, augmented @ scale), dtype=np.float64)
    b = p.time * np.asarray(np.linalg.solve(scale, inputs @ input_scale), dtype=np.float64)
    r = weights.effort * np.eye(m)
    try:
        riccati = continuous_riccati(a, b, scale @ state_weight @ scale, r)
    except LinAlgError as error:
        raise BadInput(f"no optimal PI law: {error}; weigh every mode") from None
    gain = -input_scale @ np.linalg.solve(r, b.T @ riccati) @ np.linalg.inv(scale)
    g1, g2 = gain[:, : 2 * n], gain[:, 2 * n :]
    d = linear.input_matrix
    momentum = np.linalg.solve(d.T @ d, d.T @ linear.mass)
    left_inverse = np.hstack((np.zeros((m, n)), momentum))
    proportional = g2 @ left_inverse
    integral = g1 - proportional @ p.a
    poles = np.linalg.eigvals(augmented + inputs @ gain)
    return PiGains(-integral[:, n:], -proportional[:, n:], -integral[:, :n], poles)


@dataclass(frozen=True)
class NominalDeviation:
    """-Ki e, -Kp e, -Kd e' of the deviation e from the nominal trajectory, deflections included."""

    model: LinearDesignModel
    gains: PiGains

    def __call__(self, estimate: Estimate, reference: Reference) -> Action:
        """Return the action on the deviation of the estimate."""
        n = self.model.coordinates
        requested = nominal(self.model, reference)
        e, rate = estimate.position - requested[:n], estimate.velocity - requested[n:]
        return Action(-(self.gains.ki @ e), -(self.gains.kp @ e), -(self.gains.kd @ rate))


def build(
    settings: ProportionalIntegral, plant: PlantDescription
) -> tuple[KalmanFilter | RotationFilter, IntegralLaw]:
    """Return the disturbance-augmented filter and the law.

    Raises:
        BadInput: a mode is not controllable or not observable, the weights give no regulator, or
            gains given by hand have the wrong shape or do not stabilise the operating point.
    """
    design_model = plant.design_model(settings.model)
    at = operating_point_of(plant, design_model, settings.operating_point)
    platform = rate_dependent_platform(design_model, at)
    model = joints_first(design_model, at) if platform is None else platform.small
    rest = operating_point_of(plant, model, settings.operating_point)
    linear = model.linearise(rest)
    require_controllable(linear.state_matrix, linear.state_input_matrix, state_names(model))
    if settings.gains is None:
        gains = design(linear, settings.weights)
    else:
        gains = _gain_matrices(model, settings.gains)
    names = (*state_names(model), *(f"integral of {name}" for name in model.joint_names))
    loop = integral_loop(linear, gains.kp, gains.kd, gains.ki, None)
    require_stable(loop, names, "proportional_integral with these gains")
    if isinstance(model, LinearModel):
        require_sampled_stability(
            lambda h: integral_loop(linear, gains.kp, gains.kd, gains.ki, h),
            plant.period,
            "proportional_integral",
        )
    limit = plant.effort_limit
    law = IntegralLaw(NominalDeviation(model, gains), limit, settings.tracking_time, plant.period)
    if platform is not None:
        return rotation_filter(platform, settings.filter, plant), law
    return KalmanFilter(model, rest, settings.filter, plant.period), law


def _gain_matrices(model: LinearDesignModel, gains: GivenGains) -> PiGains:
    """Return the gains of the settings as matrices, checked for their shape."""
    shape = (model.joints, model.coordinates)
    found = []
    for name, rows in (("kp", gains.kp), ("kd", gains.kd), ("ki", gains.ki)):
        if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
            raise BadInput(f"gains.{name}: give {shape[0]} rows of {shape[1]} numbers")
        found.append(np.array(rows, dtype=np.float64))
    return PiGains(found[0], found[1], found[2], np.zeros(0, dtype=np.complex128))


def linear(
    estimator: KalmanFilter | RotationFilter, law: IntegralLaw, references: list[Reference]
) -> LinearForm | None:
    """Return the law as matrices; see LawEntry."""
    assert isinstance(law.deviation, NominalDeviation)
    found = law.deviation.gains
    m = len(found.kp)
    if isinstance(estimator, RotationFilter):
        padding = np.zeros((m, len(estimator.static.matrices.first) - found.kp.shape[1]))
        state_gains = -np.hstack((found.kp, found.kd, padding[:, found.kd.shape[1] :]))
        integral = IntegralTerm(-np.hstack((found.ki, padding)), law.integration)
        return rotation_form(estimator, state_gains, references, integral)
    gains = OnDeviation(np.hstack((found.kp, found.kd)), np.zeros((m, m)), found.ki)
    return nominal_form(estimator, gains, references, law.integration)


PROPORTIONAL_INTEGRAL = LawEntry(
    "proportional_integral", ProportionalIntegral, build, linear=linear, takes_over=True
)
