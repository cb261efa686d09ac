"""Which combinations of the modes an effort can swing: the others have no end conditions.

Two equal panels swing together and never against each other; a mode that a turn does not excite
stays at rest. With d(tau) the modal coordinates tau after a unit impulse, each as the deflection
of its tip, an effort of at most u moves a combination w by at most
    u integral |w . d| dtau
over the slew. Directions w are those of the Gramian integral d d^T dtau.
"""

import numpy as np
from scipy.linalg import expm

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Model

REACH_FLOOR = 1e-6  # reach that counts as none: a tenth of what a plan may leave [m]
_NEVER = 1e-15  # that of a single mode that the effort does not move [m]
_STEP = 0.25  # of the samples, as an angle of the fastest mode [rad]
_CONDITION = 1e-2  # smallest over largest deflection of directions that Newton's method separates


def reachable_combinations(
    model: Model, q: Vector, joint: int, amplitude: float, horizon: float
) -> Matrix:
    """Return the combinations of modal coordinates that the effort can swing, shape (k, modes).

    They are the modes themselves where all are reached and each differently.

    Args:
        model: model, linearised at q.
        q: coordinates at rest, shape (n,).
        joint: index of the joint of the effort.
        amplitude: u, largest effort [N m or N].
        horizon: duration of the effort [s].
    """
    modes, n = model.modes, model.coordinates
    if not modes:
        return np.zeros((0, 0))
    linear = model.linearise(q)
    step = _STEP / float(linear.frequencies[-1])
    transition = expm(linear.state_matrix * step)
    states = linear.state_input_matrix[:, joint][None]
    while len(states) * step < horizon:
        states = np.concatenate((states, states @ transition.T))
        transition = transition @ transition
    size = tip_sizes(model)
    deflection = states[: int(horizon / step) + 1, n - modes : n] * size
    root, directions = np.linalg.svd(deflection, full_matrices=False)[1:]
    reach = amplitude * step * np.abs(deflection @ directions.T).sum(axis=0)
    kept = reach > (REACH_FLOOR if modes > 1 else _NEVER)
    if kept.all() and root[-1] > _CONDITION * root[0]:
        return np.eye(modes)
    weight = np.where(root > 0.0, root[0] / np.maximum(root, 1e-300), 1.0)
    found: Matrix = weight[kept, None] * directions[kept] * size
    return found


def tip_sizes(model: Model) -> Vector:
    """Return how far a unit of each mode deflects a tip, one where no tip moves, (modes,)."""
    size = np.abs(model.appendages.tip).max(axis=0, initial=0.0)
    return np.where(size > 0.0, size, 1.0)
