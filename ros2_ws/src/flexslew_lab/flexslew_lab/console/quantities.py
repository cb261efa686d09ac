"""What a chart can show: curves from what the bench flew, by the name of the quantity."""

from collections.abc import Callable

import numpy as np

from flexslew_lab.console.history import Curve
from flexslew_lab.console.view import BenchView, Joints
from flexslew_lab.log.joints_flown import estimate_errors, estimated_joints
from flexslew_plant.arrays import Matrix, Vector

POSITION, VELOCITY, ERROR, EFFORT = "position", "velocity", "error", "effort"
GREY = 6  # of limits, among the colours of the charts
TIPS, INNOVATION, ESTIMATE = "tips", "innovation", "estimate minus truth"


def _columns(
    labels: tuple[str, ...], time: Vector, rows: Matrix, dashed: bool = False
) -> list[Curve]:
    """Return a curve for each joint; all curves of a joint have its colour."""
    return [
        Curve(label, time, rows[:, k], dashed, color=k)
        for k, label in enumerate(labels)
        if k < rows.shape[1]
    ]


def _named(prefix: str, joints: Joints, units: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{prefix}{n} [{u}]" for n, u in zip(joints.names, units, strict=True))


def _shared(view: BenchView, field: str, truth: str) -> tuple[Vector, Matrix, Matrix]:
    """Return the times of both topics, and their rows there."""
    controller_time, truth_time = view.controller_state.time, view.truth.time
    time, a, b = np.intersect1d(
        controller_time, truth_time, assume_unique=True, return_indices=True
    )
    return time, view.controller_state.column(field)[a], view.truth.column(truth)[b]


def _position(view: BenchView, joints: Joints) -> list[Curve]:
    names = _named("", joints, joints.units)
    requested = _named("reference ", joints, joints.units)
    truth, state = view.truth, view.controller_state
    return [
        *_columns(names, truth.time, truth.column("position")),
        *_columns(requested, state.time, state.column("reference_position"), True),
    ]


def _velocity(view: BenchView, joints: Joints) -> list[Curve]:
    rates = tuple(f"{unit}/s" for unit in joints.units)
    truth, state = view.truth, view.controller_state
    names, requested = _named("", joints, rates), _named("reference ", joints, rates)
    return [
        *_columns(names, truth.time, truth.column("velocity")),
        *_columns(requested, state.time, state.column("reference_velocity"), True),
    ]


def _error(view: BenchView, joints: Joints) -> list[Curve]:
    time, requested, position = _shared(view, "reference_position", "position")
    n = min(requested.shape[1], position.shape[1])
    error = requested[:, :n] - position[:, :n]
    if view.model is not None and n == view.model.joints:
        error = view.model.joint_error(position[:, :n], requested[:, :n])
    return _columns(_named("", joints, joints.units), time, error)


def _effort(view: BenchView, joints: Joints) -> list[Curve]:
    names = _named("", joints, joints.effort_units)
    curves = _columns(names, view.truth.time, view.truth.column("applied_effort"))
    time = view.truth.time
    for limit, unit in sorted(set(zip(joints.limit, joints.effort_units, strict=True))):
        for sign in (1.0, -1.0):
            level = np.full(len(time), sign * limit)  # in any window, it crosses all of it
            curves.append(Curve(f"limit {sign * limit:g} {unit}", time, level, True, color=GREY))
    return curves


def _tips(view: BenchView, joints: Joints) -> list[Curve]:
    rows = view.truth.column("tip_deflection")
    channels = [(k, name, "m") for k, name in enumerate(joints.appendages)]
    if view.model is not None and rows.shape[1] == len(view.model.appendages.names):
        channels = view.model.appendages.deflections
    names = tuple(f"{name} [{unit or '-'}]" for _, name, unit in channels)
    return _columns(names, view.truth.time, rows[:, [k for k, *_ in channels if k < rows.shape[1]]])


def _innovation(view: BenchView, joints: Joints) -> list[Curve]:
    rows = view.controller_state.column("innovation")
    names = tuple(f"output {k + 1}" for k in range(rows.shape[1]))
    return _columns(names, view.controller_state.time, rows)


def _estimate(view: BenchView, joints: Joints) -> list[Curve]:
    time, estimate, truth = _shared(view, "estimate_position", "position")
    _, reference, _ = _shared(view, "reference_position", "position")
    error = estimate_errors(view.model, estimated_joints(view.model, estimate, reference), truth)
    modes = tuple(f"mode {k + 1} [m]" for k in range(max(error.shape[1] - len(joints.names), 0)))
    return _columns(_named("", joints, joints.units) + modes, time, error)


_QUANTITIES: dict[str, Callable[[BenchView, Joints], list[Curve]]] = {
    POSITION: _position,
    VELOCITY: _velocity,
    ERROR: _error,
    EFFORT: _effort,
    TIPS: _tips,
    INNOVATION: _innovation,
    ESTIMATE: _estimate,
}
NAMES = tuple(_QUANTITIES)


def curves_of(view: BenchView, quantity: str) -> list[Curve]:
    """Return the curves of a quantity; none before the testbed has announced itself."""
    if view.joints is None:
        return []
    return [c for c in _QUANTITIES[quantity](view, view.joints) if np.isfinite(c.value).any()]
