"""PI control that accommodates unknown constant disturbances (Kwak 1989, (3-12) to (3-24)).

z = (x, u), u' = -R^-1 Bhat^T P z = G1 x + G2 u. With the left inverse B^L = [0, (B*)^+ M] of B,
u = Gp x + Gi integral(x), Gp = G2 B^L, Gi = G1 - G2 B^L A. Gp works on rates alone, and the
integral of the rates is the displacement: nothing measured as a rate is integrated.
"""

import numpy as np

from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.lqr import regulator
from flexslew_control.controllers.retargeting.small_motion_laws import (
    IntegralFeedback,
    integral_form,
)
from flexslew_control.estimators.small_motion_observer import ObserverSettings, observer
from flexslew_control.law import Estimator, PlantDescription
from flexslew_control.linear.design_checks import require_controllable
from flexslew_control.linear.small_motion import Frozen, design_motion, require_full_rank
from flexslew_control.shared_keys import TrackingTime, WholeModel
from flexslew_plant.arrays import Matrix
from flexslew_plant.settings import Positive, section


@section
class IntegralWeights:
    """Qhat and R of the regulator of (x, u), in the units of the testbed's section."""

    state: Positive = 100.0  # weight on every coordinate and rate
    effort: Positive = 1.0  # weight on every effort
    effort_rate: Positive = 0.001  # weight on the rate of every effort


@section
class DisturbanceAccommodating:
    """PI control of a platform with turning antennas that rejects a disturbance."""

    model: WholeModel = None
    # `state`, `effort` and `effort_rate` of the regulator
    weights: IntegralWeights = IntegralWeights()
    observer: ObserverSettings = ObserverSettings()  # noises of the estimator
    tracking_time: TrackingTime = 10.0


def augmented(before: Frozen) -> tuple[Matrix, Matrix]:
    """Return Ahat and Bhat of z = (x, u) (3-17), shapes (2 k + m, 2 k + m), (2 k + m, m)."""
    a, b = before.state_matrix, before.state_input_matrix
    size, m = b.shape
    whole = np.zeros((size + m, size + m))
    whole[:size, :size], whole[:size, size:] = a, b
    return whole, np.vstack((np.zeros((size, m)), np.eye(m)))


def integral_gains(before: Frozen, weights: IntegralWeights) -> Matrix:
    """Return [Kp, Kd, Ki] of u = -Kp x - Kd x' - Ki integral(x), shape (m, 3 k).

    Raises:
        BadInput: there is no such regulator.
    """
    a, b = before.state_matrix, before.state_input_matrix
    size, m = b.shape
    whole, inputs = augmented(before)
    q = np.diag([weights.state] * size + [weights.effort] * m)
    gain, _ = regulator(whole, inputs, q, weights.effort_rate * np.eye(m))
    g1, g2 = -gain[:, :size], -gain[:, size:]
    k = size // 2
    left = np.zeros((m, size))
    left[:, k:] = np.linalg.lstsq(before.input_matrix, before.mass, rcond=None)[0]
    gp, gi = g2 @ left, g1 - g2 @ left @ a
    # the rates' share of the integral is the displacement
    return -np.hstack((gi[:, k:], gp[:, k:], gi[:, :k]))


def build(
    settings: DisturbanceAccommodating, plant: PlantDescription
) -> tuple[Estimator, IntegralFeedback]:
    """Return the estimator of small motions and the law.

    Raises:
        BadInput: a motion is not controllable or does not show in the readings, or two efforts do
            the same.
    """
    motion = design_motion(plant, settings.model)
    before = motion.before()
    require_full_rank(before, motion)
    names = (*motion.names, *(f"{name} rate" for name in motion.names))
    require_controllable(before.state_matrix, before.state_input_matrix, names)
    gains = motion.gains(integral_gains(before, settings.weights))
    law = IntegralFeedback(
        gains, motion.rest_position, plant.effort_limit, settings.tracking_time, plant.period
    )
    return observer(motion, settings.observer, plant.period), law


DISTURBANCE_ACCOMMODATING = LawEntry(
    "disturbance_accommodating",
    DisturbanceAccommodating,
    build,
    follows_reference=False,
    linear=integral_form,
)
