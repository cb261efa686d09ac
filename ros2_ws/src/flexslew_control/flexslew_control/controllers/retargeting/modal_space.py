"""Independent modal-space control (Kwak 1989, (4-15), (4-20)): every mode on its own.

f_i = -w (s - w) q_i - sqrt(2 w (s - w) + 1/R) q_i', s = sqrt(w^2 + 1/R): the linear quadratic
regulator of one mode with Q = diag(w^2, 1). What has no stiffness gets a feedback of its rate.
"""

import numpy as np

from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.retargeting.small_motion_laws import StateFeedback, state_form
from flexslew_control.estimators.small_motion_observer import ObserverSettings, observer
from flexslew_control.law import Estimator, PlantDescription
from flexslew_control.linear.small_motion import Frozen, design_motion, require_full_rank
from flexslew_control.shared_keys import WholeModel
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import NonNegative, Positive, section

_SOFT = 1e-9  # of the largest w^2: less is no mode


@section
class ModalSpace:
    """Control of each mode on its own, for a platform with turning antennas."""

    model: WholeModel = None
    weight: Positive = 0.0002  # R of every mode, in the units of the testbed's section
    rate_gain: NonNegative = 10.0  # rate gain of rigid-body modes, times inertia [1/s]
    observer: ObserverSettings = ObserverSettings()  # noises of the estimator


def modal_gains(squares: Vector, weight: float) -> tuple[Vector, Vector]:
    """Return the gains on displacement and rate of modes of mass one (4-15).

    Args:
        squares: w^2, shape (k,) [1/s^2].
        weight: R.
    """
    w = np.sqrt(squares)
    s = np.sqrt(squares + 1.0 / weight)
    position_gain = w * (s - w)
    return position_gain, np.sqrt(2.0 * position_gain + 1.0 / weight)


def space_gains(before: Frozen, weight: float, rate_gain: float) -> Matrix:
    """Return K of u = -K (x, x'), shape (m, 2 k).

    What the modes' efforts do to the platform is not balanced: every motion is on its own.

    Args:
        before: the equations before the manoeuvre.
        weight: R.
        rate_gain: of what has no stiffness, times its inertia [1/s].
    """
    mass, b = np.diag(before.mass), before.input_matrix
    squares = np.diag(before.stiffness) / mass
    elastic = squares > _SOFT * squares.max()
    position_gain, damping = modal_gains(np.where(elastic, squares, 0.0), weight)
    position = np.diag(np.where(elastic, mass * position_gain, 0.0))
    rate = np.diag(np.where(elastic, mass * damping, mass * rate_gain))
    requested = np.hstack((position, rate))
    gains = np.linalg.pinv(b[elastic]) @ requested[elastic]
    rigid = ~(abs(b[elastic]) > 0.0).any(axis=0)  # efforts that move no mode
    gains[rigid] += np.linalg.pinv(b[np.ix_(~elastic, rigid)]) @ requested[~elastic]
    return np.asarray(gains)


def build(settings: ModalSpace, plant: PlantDescription) -> tuple[Estimator, StateFeedback]:
    """Return the estimator of small motions and the law.

    Raises:
        BadInput: two efforts are dependent, or a motion does not show in the readings.
    """
    motion = design_motion(plant, settings.model)
    before = motion.before()
    require_full_rank(before, motion)
    gain = space_gains(before, settings.weight, settings.rate_gain)
    return observer(motion, settings.observer, plant.period), StateFeedback(
        motion.gains(gain), motion.rest_position
    )


MODAL_SPACE = LawEntry(
    "modal_space", ModalSpace, build, follows_reference=False, linear=state_form, takes_over=True
)
