"""What a law reads on the body axes, and what its torques are, taken from its running code.

An allocation makes efforts of a torque, and a filter may estimate the attitude. Two laws of gains
alone on the same axes have the memory of the filter: the torque e + e' of one and e + 2 e' of the
other give the errors e and their rates e' that it hands to a law.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.minimal import minimal_part
from flexslew_control.controllers import LINEAR, law_values
from flexslew_control.controllers.by_joint.three_axes import control_axes
from flexslew_lab.analysis.trial_models import Point, running_law_at
from flexslew_lab.trial.trial import Trial, plant_of
from flexslew_plant.arrays import Matrix
from flexslew_plant.settings import validated

_GAIN = 100.0  # of the two laws [N m/rad]: their torques are large beside null motion


@dataclass(frozen=True)
class BodyAxisSignals:
    """The signals of a law on body axes; null motion and unloading of wheels are left out.

    Args:
        names: of the axes.
        reader: from sensors, applied efforts and references of joints to `error.AXIS` [rad], then
            `error_rate.AXIS` [rad/s].
        torque: torque of a unit effort of each joint, shape (axes, joints).
        spread: efforts of a unit torque about each axis, shape (joints, axes).
    """

    names: tuple[str, ...]
    reader: Lti
    torque: Matrix
    spread: Matrix


def body_axis_signals(
    trial: Trial, name: str, section: Mapping[str, Any], point: Point
) -> BodyAxisSignals | None:
    """Return the signals of a controller that runs the law `linear`; None: its axes are joints.

    Args:
        trial: of the bench.
        name: of the controller.
        section: its keys without a system.
        point: about which the loop is linear.

    Raises:
        BadInput: if the torque cannot be shared out so, or the drives are not linear there.
    """
    source = f"controllers.{name}"
    allocation = validated(LINEAR.settings, law_values(dict(section)), source).allocation
    if allocation is None:
        return None
    what = control_axes(plant_of(trial), allocation, False)
    assert what.allocator is not None
    torque, eye = what.allocator.torque, np.eye(len(what.names))
    forms = []
    for rate in (1.0, 2.0):
        system = {"d": (_GAIN * np.hstack((eye, rate * eye))).tolist()}
        values = {**section, "law": LINEAR.name, "system": system, "allow_unstable": True}
        forms.append(running_law_at(trial, name, values, point, source).form)
    once, twice = forms
    back = torque / _GAIN
    (c, d), (c2, d2) = ((back @ form.c, back @ form.d) for form in (once, twice))
    outputs = tuple(f"{kind}.{axis}" for kind in ("error", "error_rate") for axis in what.names)
    reader = Lti(
        once.a, once.b, np.vstack((2.0 * c - c2, c2 - c)), np.vstack((2.0 * d - d2, d2 - d)),
        once.inputs, outputs, once.states, once.period,
    )  # fmt: skip
    return BodyAxisSignals(what.names, minimal_part(reader), torque, what.allocator.spread)
