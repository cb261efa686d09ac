"""Output feedback control: sliding surfaces, observer and elastic reference (Sung and Joo).

Modes:
    tracking_a  the non-linear model stands in the law and in the observer;
    tracking_b  the linear model at the operating point, D = 0;
    rigid_hold  as tracking_a, with the reference's deflection set to zero.

Observers:
    kalman  predicts over the tick with the non-linear model in every mode and corrects with the
            Kalman gain of the tick, from what is known at the start; its covariance is right at
            rest and in a slew.
    steady  the paper's (5): the stationary gain K_f, the measurement held over the tick. It lags
            by omega T / 2 in a slew, and the covariance of its ticks, which it states, is right at
            rest alone.

A craft that is free in space is controlled about its plan: see plan_deviation. The observer is then
a RotationFilter, and tracking_b has the A of rest in the law.
"""

from typing import Literal

import numpy as np

from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.sampled_loop import (
    LinearPlant,
    appendage_loop,
    integral_loop,
    require_sampled_stability,
)
from flexslew_control.controllers.sliding.appendage_feedback import (
    AppendageFeedback,
    appendage_model,
)
from flexslew_control.controllers.sliding.design_model import JointsAndModes
from flexslew_control.controllers.sliding.plan_deviation import PlanDeviation
from flexslew_control.controllers.sliding.sliding_law import (
    SampledObserver,
    SlidingLaw,
    sliding_form,
)
from flexslew_control.controllers.sliding.sliding_surface import LinearSystem, design
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter, continuous_gain
from flexslew_control.estimators.rotation_filter import RotationFilter, rotation_filter
from flexslew_control.law import PlantDescription
from flexslew_control.linear.design_checks import (
    LinearDesignModel,
    OperatingPoint,
    operating_point_of,
    output_matrix,
    require_stable,
    state_names,
)
from flexslew_control.linear.free_platform import LinearModel
from flexslew_control.linear.rate_dependent_platform import free_platform
from flexslew_control.shared_keys import DesignModel
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.model import Model

_MODAL_NOISE = 0.00025  # of joints and modes, unless it is given [N^2 s]
# of a free craft, of the noise on efforts [1/m^2]: with less, its filter holds on to modes that are
# not as believed, and the loop is lost on panels that are 20 % softer
_FREE_NOISE = 10.0


@section
class OutputFeedback:
    """Sliding surfaces on an observer, with an elastic reference (Sung and Joo)."""

    # strategy
    mode: Literal["tracking_a", "tracking_b", "rigid_hold"] = "tracking_a"
    model: DesignModel = None
    # joint positions at mid-slew, by name [rad or m]; null: half of those of the testbed
    operating_point: OperatingPoint = None
    reaching_rate: Positive = 2.0  # rate nu at which the hypersurface is reached [1/s]
    weight_frequency: Positive = 0.3  # frequency omega_r of the joints in Q_s [rad/s]
    attitude_gain: NonNegative = 0.0  # gain kappa of eq. (51) [1/s]
    effort_noise: Positive = 0.1  # density of each effort in L Q L^T [(N m)^2 s]
    # density of the force on each mode alone [N^2 s]; null: 0.00025, of a craft that is free in
    # space ten times effort_noise
    modal_noise: Positive | None = None
    angle_sigma: Positive = 1e-4  # standard deviation of the joint encoders [rad or m]
    rate_sigma: Positive = 1e-4  # standard deviation of the joint rate sensors [rad/s or m/s]
    tip_sigma: Positive | None = None  # standard deviation of the tip sensor [m]; null: not used
    # of joints and modes (an appendage's is steady). kalman: predicts over the tick, covariance
    # right at rest and in a slew; steady: eq. (5) of the paper, which holds the measurement, lags
    # by half a tick and states the covariance of rest
    observer: Literal["kalman", "steady"] = "kalman"
    # standard deviation of each mode at a reset, of kalman [m]
    initial_deflection: NonNegative = 0.01
    # of its rate at a reset [m/s]; null: that of the mode per second, which suits modes of about
    # 1 rad/s
    initial_deflection_rate: NonNegative | None = None
    # of a spacecraft: one appendage alone, apart from the platform's, see spacecraft; null: joints
    # and modes, about the plan
    appendage: AppendageFeedback | None = None


def testbed_system(
    model: LinearDesignModel, rest: Vector, settings: OutputFeedback, period: float
) -> LinearSystem:
    """Return the linearisation at the rest q with the noises of the settings.

    Its efforts disturb as the torques do; each mode is disturbed by a force on M_qq q'' alone.
    """
    linear = model.linearise(rest)
    n, m = model.coordinates, model.joints
    modal = np.zeros((2 * n, n - m))
    modal[n + m :] = np.linalg.inv(linear.mass[m:, m:])
    b, tip = linear.state_input_matrix, settings.tip_sigma
    default = (
        _FREE_NOISE * settings.effort_noise if isinstance(model, LinearModel) else _MODAL_NOISE
    )
    modal_noise = default if settings.modal_noise is None else settings.modal_noise
    sigmas = [settings.angle_sigma] * m + [settings.rate_sigma] * m + ([] if tip is None else [tip])
    return LinearSystem(
        linear.state_matrix,
        b,
        output_matrix(model, tip is not None),
        np.hstack((b, modal)),
        np.diag([settings.effort_noise] * m + [modal_noise] * (n - m)),
        np.diag(np.square(sigmas)) * period,
        state_names(model),
    )


def testbed_weight(model: LinearDesignModel, rest: Vector, settings: OutputFeedback) -> Matrix:
    """Return Q_s = diag(M_jj omega_r^2, K_qq, M_jj, M_qq), an energy, shape (2 n, 2 n).

    Of a free craft M_jj is what the joint's effort turns and M_qq the deflections' own, both
    without what the spin of a wheel adds.
    """
    linear = model.linearise(rest)
    mass, stiffness = np.diag(linear.mass).copy(), np.diag(linear.stiffness).copy()
    m = model.joints
    if isinstance(model, LinearModel):
        mass[:m] /= np.diag(linear.input_matrix)[:m]
        mass[m:] = np.diag(model.modal_mass)
    stiffness[:m] = mass[:m] * settings.weight_frequency**2
    return np.diag(np.concatenate((stiffness, mass)))


def build(
    settings: OutputFeedback, plant: PlantDescription
) -> tuple[SampledObserver | KalmanFilter | RotationFilter, SlidingLaw]:
    """Return the observer and the law; the drive limits the effort.

    Raises:
        BadInput: the model is not controllable or observable at the operating point, the weights
            or noises give no stable design, or the steady observer diverges at this period.
    """
    if settings.appendage is not None:
        return _of_appendage(settings, settings.appendage, plant)
    model = plant.design_model(settings.model)
    if model.leading is not None:
        return _plan_controller(settings, model, plant)
    if model.efforts != model.joints:
        raise BadInput(
            f"output_feedback: needs one motor in each joint, and {plant.testbed.kind} has "
            f"{model.efforts} efforts for {model.joints} joints; take pd_feedforward"
        )
    rest = operating_point_of(plant, model, settings.operating_point, 0.5)
    system = testbed_system(model, rest, settings, plant.period)
    found = design(system, testbed_weight(model, rest, settings), settings.reaching_rate)
    require_stable(system.a - found.observer_gain @ system.c, system.names, "the observer")
    observed = JointsAndModes(
        model,
        system,
        np.concatenate((rest, np.zeros(model.coordinates))),
        settings.mode == "tracking_b",
        plant.period,
        settings.mode != "rigid_hold",
        found.observer_gain,
    )
    law = SlidingLaw(observed, found, settings.attitude_gain)
    if settings.observer == "steady":
        if not observed.linear:
            require_sampled_stability(
                lambda period: _steady_step(model, rest, settings, period),
                plant.period,
                "observer steady",
                "; or take observer: kalman, or mode: tracking_b",
            )
        return SampledObserver(observed, found, plant.period), law
    return KalmanFilter(model, rest, _sensors(settings), plant.period, _noise(system)), law


def _steady_step(model: Model, rest: Vector, settings: OutputFeedback, period: float) -> Matrix:
    """Return what a step of RK4 makes of an error of the steady observer, shape (2 n, 2 n)."""
    system = testbed_system(model, rest, settings, period)
    gain, _ = continuous_gain(system.a, system.c, _noise(system), system.sensor_density)
    drift, eye = period * (system.a - gain @ system.c), np.eye(len(system.a))
    step: Matrix = eye + drift @ (eye + drift @ (eye + drift @ (eye + drift / 4.0) / 3.0) / 2.0)
    return step


def _plan_controller(
    settings: OutputFeedback, model: Model, plant: PlantDescription
) -> tuple[RotationFilter, SlidingLaw]:
    """Return the filter and the law of a craft that is free in space; see plan_deviation."""
    for key, value, other in (
        ("mode", settings.mode, "rigid_hold"),
        ("observer", settings.observer, "steady"),
    ):
        if value == other:
            raise BadInput(
                "a craft that is free in space is controlled about its plan, deflections included; "
                "leave it out, or give the key appendage",
                key=key,
                value=value,
            )
    platform = free_platform(model, operating_point_of(plant, model, settings.operating_point))
    small, rest = platform.small, np.zeros(platform.small.coordinates)
    system = testbed_system(small, rest, settings, plant.period)
    found = design(system, testbed_weight(small, rest, settings), settings.reaching_rate)
    sensors = _sensors(settings)
    estimator = rotation_filter(platform, sensors, plant, _noise(system), "tip_sigma")
    law = SlidingLaw(
        PlanDeviation(platform, settings.mode != "tracking_b"),
        found,
        settings.attitude_gain,
        innovation_term=False,
    )
    gain = law.at_rest(system.a)
    n = small.coordinates
    require_sampled_stability(
        lambda period: integral_loop(small.linear, gain[:, :n], gain[:, n:], None, period),
        plant.period,
        "output_feedback",
        "; a lower reaching_rate takes a longer one",
    )
    return estimator, law


def _sensors(settings: OutputFeedback) -> FilterSettings:
    """Return the noises of the sensors, and of the start, for a filter."""
    return FilterSettings(
        angle_sigma=settings.angle_sigma,
        rate_sigma=settings.rate_sigma,
        tip_sigma=settings.tip_sigma,
        initial_deflection=settings.initial_deflection,
        initial_deflection_rate=settings.initial_deflection_rate,
    )


def _noise(system: LinearSystem) -> Matrix:
    """Return L Q L^T of (3)."""
    return system.noise_input @ system.noise_density @ system.noise_input.T


def _of_appendage(
    settings: OutputFeedback, appendage: AppendageFeedback, plant: PlantDescription
) -> tuple[SampledObserver, SlidingLaw]:
    """Return the observer and the law of one appendage; see appendage_feedback."""
    one, found = appendage_model(
        appendage, settings.mode, settings.reaching_rate, settings.model, plant
    )
    require_stable(one.system.a - one.gain @ one.system.c, one.system.names, "the observer")
    model = plant.testbed.model()
    linear = LinearPlant(model, model.rest({}))
    fast_weights = appendage.weight_exponents[0] > 0.0
    require_sampled_stability(
        lambda period: appendage_loop(linear, one, found, period),
        plant.period,
        f"output_feedback of {appendage.name}",
        f"; weight_exponents {list(appendage.weight_exponents)} weigh the fast modes most: "
        "the printed 6.6 (Sung and Joo, (52)) is unusable, take [0, -2]"
        if fast_weights
        else "",
    )
    return SampledObserver(one, found, plant.period), SlidingLaw(one, found)


OUTPUT_FEEDBACK = LawEntry(
    "output_feedback", OutputFeedback, build, linear=sliding_form, takes_over=True
)
