"""The public figures of the PI law with an estimator on the testbed (Kwak, 1989)."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from flexslew_control.controllers import proportional_integral
from flexslew_control.controllers.by_joint import pd_feedforward
from flexslew_control.controllers.by_joint.pd_feedforward import PdFeedforwardSettings
from flexslew_control.controllers.proportional_integral import PiGains, ProportionalIntegral
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter, outputs
from flexslew_control.law import Estimate, Estimator, Reference
from flexslew_lab.reproduce.laws import PERIOD, closed_loop, plant_of
from flexslew_lab.reproduce.rows import at_most, relative
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.model import Model

_FILE = "Kwak (1989)"
_GAINS = {  # rows of the gains of base yaw on (theta, psi, q)
    "kp": (2184.4058, 0.0, -87.066733),
    "kd": (10942.2764, 0.0, 145.675013),
    "ki": (137.871882, 0.0, -7.126876),
}
_PITCH_GAINS = {"kp": 1350.431186, "kd": 4084.949491, "ki": 116.640625}


def _reference_at(yaw: float, pitch: float, tick: int) -> Reference:
    state = np.array([yaw, pitch, 0.0, 0.0, 0.0, 0.0])
    return Reference(state[:2], np.zeros(2), np.zeros(2), state, state)


_REST_REFERENCE = partial(_reference_at, 0.0, 0.0)


def _gain_rows(gains: PiGains) -> list[dict[str, Any]]:
    rows = []
    for name, expected in _GAINS.items():
        matrix: Matrix = getattr(gains, name)
        for column in (0, 2):
            item = f"{name} of base_yaw on {'theta' if column == 0 else 'q'}"
            found = float(matrix[0, column])
            rows.append(relative(item, _FILE, expected[column], found, 1e-6))
        pitch = float(matrix[1, 1])
        rows.append(relative(f"{name} of hub_pitch", _FILE, _PITCH_GAINS[name], pitch, 1e-6))
    return rows


@dataclass
class _SteadyFilter:
    """x+ = f(x, u) + K (y - C x), the prediction non-linear, and K that of the operating point.

    Args:
        model: equations of motion.
        gain: K on (q, v, d), shape (2 n + joints, 2 joints).
    """

    model: Model
    gain: Matrix
    _x: Vector = field(init=False)
    _tick: int = field(init=False, default=-1)

    def reset(self, measurement: Measurement) -> None:
        """Start at rest at the measured joints, without disturbance."""
        self._x = np.zeros(len(self.gain))
        self._x[: self.model.joints] = measurement.joint_position
        self._tick = measurement.tick

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick."""
        n, m = self.model.coordinates, self.model.joints
        empty = np.zeros(0)
        innovation = empty
        if measurement.tick != self._tick:
            state, d = self._x[: 2 * n], self._x[2 * n :]
            state = self.model.advance(state, measurement.applied_effort + d, PERIOD)
            seen = np.concatenate((state[:m], state[n : n + m]))
            innovation = outputs(measurement, 2 * m) - seen
            self._x = np.concatenate((state, d)) + self.gain @ innovation
            self._tick = measurement.tick
        x = self._x
        return Estimate(x[:n], x[n : 2 * n], x[2 * n :], np.zeros((0, 0)), innovation)


@dataclass
class _TrueState:
    """The estimator with the true state: a second simulation of the testbed.

    Args:
        model: equations of motion of the testbed, one mode.
        disturbance: disturbance of its joints, shape (joints,) [N m].
    """

    model: Model
    disturbance: Vector
    _x: Vector = field(init=False)
    _tick: int = field(init=False, default=-1)

    def reset(self, measurement: Measurement) -> None:
        """Start at rest at the measured joints."""
        self._x = np.zeros(2 * self.model.coordinates)
        self._x[: self.model.joints] = measurement.joint_position
        self._tick = measurement.tick

    def update(self, measurement: Measurement) -> Estimate:
        """Return the state at this tick."""
        if measurement.tick != self._tick:
            total = measurement.applied_effort + self.disturbance
            self._x = self.model.advance(self._x, total, PERIOD)
            self._tick = measurement.tick
        q, v = np.split(self._x, 2)
        return Estimate(q, v, self.disturbance, np.zeros((0, 0)), np.zeros(0))


_PUSH = 5.0  # on the base yaw [N m]
_CASES: dict[str, tuple[FilterSettings | None, float, float]] = {
    # estimator, peak yaw [rad], time to less than 1 mrad [s]
    "the true state": (None, 0.00180, 24.79),
    "a steady filter, walk 10": (FilterSettings(), 0.00185, 24.61),
    "a steady filter, walk 10, torque noise 1, modal force noise .3": (
        FilterSettings(effort_noise=1.0**2, modal_noise=0.3**2),
        0.00399,
        22.36,
    ),
}


def _rejection_rows(design_testbed: CsaTestbed) -> list[dict[str, Any]]:
    """Return peak and time of a push of 5 N m at psi = 0, with three estimators."""
    model, plant = design_testbed.model(), plant_of(design_testbed)
    rest = model.rest(design_testbed.operating_point)
    rows = []
    for name, (sensors, peak, time) in _CASES.items():
        estimator: Estimator = _TrueState(model, np.array([_PUSH, 0.0]))
        if sensors is not None:
            gain = KalmanFilter(model, rest, sensors, PERIOD).steady_state_gain()
            estimator = _SteadyFilter(model, gain)
        law = proportional_integral.build(ProportionalIntegral(), plant)[1]
        response = closed_loop(
            design_testbed,
            (estimator, law),
            _REST_REFERENCE,
            60.0,
            disturbance=_PUSH,
            from_rest=True,
        )
        error = abs(response.state[:, 0])
        large = float(np.nonzero(error > 1e-3)[0].max() * PERIOD)
        rows += [
            relative(f"PI with {name}: peak yaw [rad]", _FILE, peak, float(error.max()), 0.01),
            relative(f"PI with {name}: below 1 mrad after [s]", _FILE, time, large, 0.01),
        ]
    return rows


def pi_rows() -> list[dict[str, Any]]:
    """Return the gains, the rejection of 5 N m and the anti-windup figures of the PI law.

    The runs are at psi = 0 with the gains of psi = 0.5.
    """
    design_testbed = CsaTestbed(variant="printed", modes=1)
    real = CsaTestbed(variant="printed", modes=3)
    settings, plant = ProportionalIntegral(), plant_of(design_testbed)
    controller = proportional_integral.build(settings, plant)
    model = design_testbed.model()
    operating_point = model.linearise(model.rest(design_testbed.operating_point))
    rows = _gain_rows(proportional_integral.design(operating_point, settings.weights))
    response = closed_loop(
        real, controller, _REST_REFERENCE, 150.0, disturbance=_PUSH, from_rest=True
    )
    pd = pd_feedforward.build(PdFeedforwardSettings(), plant)
    left = closed_loop(design_testbed, pd, _REST_REFERENCE, 900.0, disturbance=_PUSH).state[-1, 0]
    rows += [
        relative("PD: yaw under 5 N m [rad]", _FILE, _PUSH / 460.0, float(left), 0.01),
        at_most(
            "PI: yaw after 150 s of 5 N m [rad]", _FILE, 1e-6, abs(float(response.state[-1, 0]))
        ),
        *_rejection_rows(design_testbed),
    ]
    for time, name, reference in ((None, "none", 0.226), (2.0, "2 s", 0.066)):
        integral_settings = ProportionalIntegral(tracking_time=time)
        built = proportional_integral.build(integral_settings, plant_of(design_testbed, 100.0))
        run = closed_loop(real, built, partial(_reference_at, 0.5, 0.0), 60.0)
        over = float(run.state[:, 0].max() - 0.5)
        item = f"overshoot of a 0.5 rad step, anti-windup {name} [rad]"
        rows.append(relative(item, _FILE, reference, over, 0.01))
    return rows
