"""Errors of knowledge: what the law takes the joints for, less where they are."""

from collections.abc import Iterator

import numpy as np

from flexslew_control.law import MeasuredJoints
from flexslew_lab.budget.contribution import Contribution, ErrorParts, fixed, noisy
from flexslew_lab.budget.sources import ObservedLoop, reading_turns
from flexslew_lab.budget.windows import knowledge_names
from flexslew_lab.trial.trial import build_controllers
from flexslew_plant.errors import BadInput

_WORDS = "readings are what the law takes the joints for"


def knowledge_sources(at: ObservedLoop, source: str) -> Iterator[Contribution]:
    """Yield errors of knowledge of a law that reads its joints.

    They are those of the joint sensors: noise, bias and quantum, directly.

    Args:
        at: the trial, its loop and its windows.
        source: file of the trial, for an error.

    Raises:
        BadInput: if an estimator stands between the sensors and the law.
    """
    controller = build_controllers(at.trial, source)[at.loop.controller]
    if not isinstance(controller.estimator, MeasuredJoints):
        kind = type(controller.estimator).__name__
        raise BadInput(f"the error of an estimate by {kind} is not computed; read its covariance")
    errors, rest = at.trial.sensors.joint_position, at.loop.point.rest
    turns = reading_turns(rest.model, rest.model.joint_state(rest.state)[0])
    from_reading = at.loop.axes.from_joints @ turns
    place = "sensors.joint_position"
    for key, size in (
        ("noise", errors.noise),
        ("quantisation", errors.quantisation / np.sqrt(12.0)),
    ):
        if size:
            response = np.zeros((at.ticks, *from_reading.shape))
            response[0] = size * from_reading
            parts = noisy(at.windows.of_noise(response))
            yield Contribution(f"{place}.{key}: knowledge", key, _WORDS, _renamed(parts))
    if errors.bias:
        bias = errors.bias * from_reading.sum(axis=1)
        parts = fixed(at.windows.of_series(np.tile(bias, (at.ticks, 1))))
        yield Contribution(f"{place}.bias: knowledge", "bias", _WORDS, _renamed(parts))


def _renamed(parts: dict[str, ErrorParts]) -> dict[str, ErrorParts]:
    """Return the parts by the names of errors of knowledge."""
    return {knowledge_names({name: part.fixed}).popitem()[0]: part for name, part in parts.items()}
