"""Where joints are, from logs that hold a state and what laws believe of it."""

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.model import Model


def joints_and_modes(
    model: Model | None, position: Matrix, velocity: Matrix
) -> tuple[Matrix, Matrix]:
    """Return where joints and modes are and how fast, each of shape (ticks, joints + modes).

    Args:
        model: model of the testbed; None: unknown.
        position: q of the truth, shape (ticks, positions).
        velocity: v of the truth, shape (ticks, coordinates).
    """
    if model is None or model.reading is None:
        return position, velocity
    if (position.shape[1], velocity.shape[1]) != (model.positions, model.coordinates):
        return position, velocity  # of another testbed
    state = np.hstack((position, velocity))
    pairs = zip(model.joint_states(state), model.modal_state(state), strict=True)
    place, rate = map(np.hstack, pairs)
    return place, rate


def estimated_joints(model: Model | None, estimate: Matrix, reference: Matrix) -> Matrix:
    """Return an estimate with joints that read an attitude where they would read it.

    In a log they are as far from the reference as the rotation between them.

    Args:
        model: model of the testbed; None: unknown.
        estimate: joints and modes, shape (ticks, joints + modes).
        reference: joints, shape (ticks, joints).
    """
    joints = reference.shape[1]
    if model is None or model.attitude is None or not estimate.shape[1] >= joints == model.joints:
        return estimate
    joint_estimate = model.attitude.add_error(reference, estimate[:, :joints] - reference)
    return np.hstack((joint_estimate, estimate[:, joints:]))


def estimate_errors(model: Model | None, estimate: Matrix, truth: Matrix) -> Matrix:
    """Return estimate - truth of what both have; of an attitude the rotation between them.

    Args:
        model: model of the testbed; None: unknown.
        estimate: as estimated_joints has it, shape (ticks, n).
        truth: as joints_and_modes has it, shape (ticks, m).
    """
    n = min(estimate.shape[1], truth.shape[1])
    error: Matrix = estimate[:, :n] - truth[:, :n]
    if model is not None and model.attitude is not None and n >= model.joints:
        ends = truth[:, : model.joints], estimate[:, : model.joints]
        error[:, : model.joints] = model.attitude.error(*ends)
    return error
