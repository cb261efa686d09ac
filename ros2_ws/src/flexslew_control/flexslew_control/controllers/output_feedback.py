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
            by omega T / 2 in a slew, and P of (7), which it states, is right at rest alone.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from flexslew_control.controllers.appendage_feedback import (
    AppendageFeedback,
    appendage_model,
)
from flexslew_control.controllers.design_model import DesignModel, JointsAndModes
from flexslew_control.controllers.sampled_loop import (
    LinearPlant,
    appendage_loop,
    require_sampled_stability,
)
from flexslew_control.controllers.sliding_surface import LinearSystem, SlidingDesign, design
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter
from flexslew_control.law import Estimate, PlantDescription, Reference
from flexslew_control.linear_design import (
    OperatingPoint,
    operating_point_of,
    output_matrix,
    require_stable,
    state_names,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.measurement import Measurement
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds.model import Model


@section
class OutputFeedback:
    """The settings of controller `output_feedback`."""

    mode: Literal["tracking_a", "tracking_b", "rigid_hold"] = "tracking_a"
    model: dict[str, Any] | None = None  # what it believes of the testbed; null: one mode
    operating_point: OperatingPoint = None  # mid-slew [rad]; null: half of the testbed's own
    reaching_rate: Positive = 2.0  # nu [1/s]
    weight_frequency: Positive = 0.3  # omega_r, of the joints in Q_s [rad/s]
    attitude_gain: NonNegative = 0.0  # kappa of (51) [1/s]
    effort_noise: Positive = 0.1  # density of each effort in L Q L^T [(N m)^2 s]
    modal_noise: Positive = 0.00025  # density of each force on M_qq q'' alone [N^2 s]
    angle_sigma: Positive = 1e-4  # [rad or m]
    rate_sigma: Positive = 1e-4  # [rad/s or m/s]
    tip_sigma: Positive | None = None  # of the tip sensor [m]; null: it is not used
    observer: Literal["kalman", "steady"] = "kalman"  # of joints and modes; an appendage's: steady
    initial_deflection: NonNegative = 0.01  # sigma of each mode at a reset [m], [m/s]; kalman
    # of a spacecraft: the appendage alone, apart from the platform's; null: joints and modes
    appendage: AppendageFeedback | None = None


@dataclass
class SampledObserver:
    """z_hat' = f(z_hat, u) + K_f (y - C z_hat) (5), with y and the applied u held over each tick.

    The estimate at tick k rests on the measurements before k; the law adds K_f y(k) itself.

    Args:
        observed: what is observed.
        found: K_f and P.
        period: one tick [s].
    """

    observed: DesignModel
    found: SlidingDesign
    period: float
    _z: Vector = field(init=False)
    _y: Vector = field(init=False)
    _tick: int = field(init=False, default=-1)
    _last: Estimate = field(init=False)
    _reference: Reference | None = field(init=False, default=None)  # of the tick of _y
    _coming: Reference | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Precompute the inverse of the innovation's covariance."""
        s = self.observed.system
        variance = s.c @ self.found.covariance @ s.c.T + s.sensor_density / self.period
        self._inverse, self._variance = np.linalg.inv(variance), np.diag(variance)
        self._covariance = self.found.covariance.copy()
        self._covariance.flags.writeable = False

    def expect(self, reference: Reference) -> None:
        """Take the reference of the measurement that comes next: it says what is known of D(t)."""
        self._coming = reference

    def reset(self, measurement: Measurement) -> None:
        """Start at the measured joints with straight appendages at rest."""
        self._z = self.observed.start(measurement)
        self._tick = measurement.tick
        self._take(measurement)

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick; the same again for a measurement that is repeated."""
        if measurement.tick != self._tick:
            effort = self.observed.efforts(measurement)
            gain = self.found.observer_gain
            self._z = self.observed.advanced(self._z, self._y, effort, gain, self._reference)
            self._tick = measurement.tick
            self._take(measurement)
        return self._last

    def innovation_variance(self) -> Vector:
        """Return the variance of each innovation with the stationary covariance, shape (l,)."""
        return self._variance

    def _take(self, measurement: Measurement) -> None:
        self._reference = self._coming
        self._y = self.observed.outputs(measurement)
        z = self._z
        e = self._y - self.observed.system.c @ z
        nis = float(e @ self._inverse @ e)
        position, velocity = self.observed.estimate(z, measurement)
        self._last = Estimate(position, velocity, np.zeros(0), self._covariance, e, nis)


@dataclass
class SlidingLaw:
    """u = -(G B)^-1 {G [f(z_hat, 0) + K_f e - z*'] + nu G (z_hat - z*) + kappa G z_re} (51).

    e = y - C z_hat. f(z, 0) = A z + D, and B is that at z_hat (tracking (a)) or at the operating
    point with D = 0 (tracking (b)). What z leaves out of the bench is held by its own feedback.

    Args:
        observed: what is controlled.
        found: G and nu.
        attitude_gain: kappa, on the joints' rows of z_hat - z* [1/s].
    """

    observed: DesignModel
    found: SlidingDesign
    attitude_gain: float = 0.0
    terms: dict[str, Vector] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Precompute what does not change."""
        nu, kappa = self.found.reaching_rate, self.attitude_gain
        # nu G + kappa G on the joints' columns alone
        self._reaching = self.found.surface * (nu + kappa * self.observed.joint_rows)
        self._innovation_gain = self.found.surface @ self.found.observer_gain

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Nothing to choose: the law has no state of its own."""

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts, shape (joints,) [N m or N]."""
        observed, surface = self.observed, self.found.surface
        z = observed.state(estimate)
        nominal, slope = observed.wanted(reference)
        drift, inverse = observed.drift(z, reference), observed.effectiveness(z, surface)
        summands = {
            "feedforward": inverse @ (surface @ slope),
            "equivalent": -inverse @ (surface @ drift),
            "innovation": -inverse @ (self._innovation_gain @ estimate.innovation),
            "reaching": -inverse @ (self._reaching @ (z - nominal)),
        }
        self.terms = {name: observed.on_bench(effort) for name, effort in summands.items()}
        self.terms |= observed.platform(measurement, reference)
        total: Vector = sum(self.terms.values(), start=_NOTHING)
        return total


_NOTHING = np.zeros(())


def testbed_system(
    model: Model, rest: Vector, settings: OutputFeedback, period: float
) -> LinearSystem:
    """Return the linearisation at the rest q with the noises of the settings.

    Its efforts disturb as the torques do; each mode is disturbed by a force on M_qq q'' alone.
    """
    linear = model.linearise(rest)
    n, m = model.coordinates, model.joints
    modal = np.zeros((2 * n, n - m))
    modal[n + m :] = np.linalg.inv(linear.mass[m:, m:])
    b, tip = linear.state_input_matrix, settings.tip_sigma
    sigmas = [settings.angle_sigma] * m + [settings.rate_sigma] * m + ([] if tip is None else [tip])
    return LinearSystem(
        linear.state_matrix,
        b,
        output_matrix(model, tip is not None),
        np.hstack((b, modal)),
        np.diag([settings.effort_noise] * m + [settings.modal_noise] * (n - m)),
        np.diag(np.square(sigmas)) * period,
        state_names(model),
    )


def testbed_weight(model: Model, rest: Vector, settings: OutputFeedback) -> Matrix:
    """Return Q_s = diag(M_jj omega_r^2, K_qq, M_jj, M_qq), an energy, shape (2 n, 2 n)."""
    linear = model.linearise(rest)
    mass, stiffness = np.diag(linear.mass), np.diag(linear.stiffness).copy()
    m = model.joints
    stiffness[:m] = mass[:m] * settings.weight_frequency**2
    return np.diag(np.concatenate((stiffness, mass)))


def build(
    settings: OutputFeedback, plant: PlantDescription
) -> tuple[SampledObserver | KalmanFilter, SlidingLaw]:
    """Return the observer and the law; the drive limits the effort.

    Raises:
        BadInput: the model is not controllable or observable at the operating point, or the weights
            or noises give no stable design.
    """
    if settings.appendage is not None:
        return _of_appendage(settings, settings.appendage, plant)
    model = plant.believed(settings.model)
    if model.efforts != model.joints or model.positions != model.coordinates:
        raise BadInput(
            f"output_feedback: needs one motor in each joint, and {plant.testbed.kind} has "
            f"{model.efforts} efforts for {model.joints} joints; give the key appendage, whose "
            "efforts it then takes"
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
        return SampledObserver(observed, found, plant.period), law
    sensors = FilterSettings(
        angle_sigma=settings.angle_sigma,
        rate_sigma=settings.rate_sigma,
        tip_sigma=settings.tip_sigma,
        initial_deflection=settings.initial_deflection,
    )
    noise = system.noise_input @ system.noise_density @ system.noise_input.T  # L Q L^T of (3)
    return KalmanFilter(model, rest, sensors, plant.period, noise), law


def _of_appendage(
    settings: OutputFeedback, chosen: AppendageFeedback, plant: PlantDescription
) -> tuple[SampledObserver, SlidingLaw]:
    """Return the observer and the law of one appendage; see appendage_feedback."""
    one, found = appendage_model(
        chosen, settings.mode, settings.reaching_rate, settings.model, plant
    )
    require_stable(one.system.a - one.gain @ one.system.c, one.system.names, "the observer")
    model = plant.testbed.model()
    linear = LinearPlant(model, model.rest({}))
    printed = chosen.weight_exponents[0] > 0.0
    require_sampled_stability(
        lambda period: appendage_loop(linear, one, found, period),
        plant.period,
        f"output_feedback of {chosen.name}",
        f"; weight_exponents {list(chosen.weight_exponents)} weigh the fast modes most: "
        "the printed 6.6 (Sung and Joo, (52)) is unusable, take [0, -2]"
        if printed
        else "",
    )
    return SampledObserver(one, found, plant.period), SlidingLaw(one, found)
