"""The sampled plant of a trial at any values of its uncertain parameters."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flexslew_control.analysis.linear_plant import PlantPath, continuous_plant, sampled_plant
from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.modes import Mode, natural_modes
from flexslew_control.analysis.rest import Rest, rest_of
from flexslew_control.analysis.signals import states_of
from flexslew_lab.analysis.trial_models import Point
from flexslew_lab.guarantee.model.mode_changes import ModeChange, mode_key, with_modes
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed, with_changes

NAMED = {
    "stiffness": "factor on the testbed's stiffness [-]",
    "payload": "factor on the testbed's payload [-]",
    "gain": "factor on the efforts of all motors [-]",
    "gain.JOINT": "factor on the effort of one motor [-]",
    "lag": "time constant of the motors [s]",
    "delay": "delay of all commands, in addition to that of the trial [s]",
    "mode.N.frequency": "frequency of a natural mode, its shape as it is [rad/s]",
    "mode.N.damping": "damping ratio of a natural mode [-]",
    "testbed.KEY": "a number of the testbed's section",
}


@dataclass(frozen=True)
class Situation:
    """Where a trial's plant is linear: what stands there, where, and the path to its motors.

    `modes` holds what natural modes have instead of their own, by their number.
    """

    trial: Trial
    testbed: Testbed
    rest: Rest
    path: PlantPath
    modes: Mapping[int, ModeChange] = field(default_factory=dict)

    def changed(self, changes: Mapping[str, float]) -> "Situation":
        """Return it with values of uncertain parameters by name, see NAMED.

        Raises:
            BadInput: if a value is not allowed.
        """
        testbed, path = self.testbed, self.path
        efforts = len(self.rest.model.joint_names)
        factors = {k: v for k, v in changes.items() if k in ("stiffness", "payload")}
        if factors:
            testbed = testbed.scaled(**factors)
        keys: dict[str, Any] = {}
        modes = dict(self.modes)
        for name, value in changes.items():
            if name.startswith("testbed."):
                keys[name.removeprefix("testbed.")] = value
            elif name == "gain" or name.startswith("gain."):
                gain = np.ones(efforts) if path.gain is None else path.gain.copy()
                one = name.partition(".")[2]
                which = self.rest.model.joint_names.index(one) if one else slice(None)
                gain[which] *= value
                path = replace(path, gain=gain)
            elif name == "lag":
                path = replace(path, actuator=replace(path.actuator, lag=value))
            elif name == "delay":
                late = np.zeros(efforts) if path.delay is None else path.delay
                path = replace(path, delay=late + value / path.period)
            elif (key := mode_key(name)) is not None:
                modes[key[0]] = modes.get(key[0], ModeChange())._replace(**{key[1]: value})
        if keys:
            testbed = with_changes(testbed, override_values({}, keys), "vary")
        if testbed is self.testbed:
            return replace(self, path=path, modes=modes)
        rest = rest_of(testbed, self.rest.joints, self.rest.time)
        return replace(self, testbed=testbed, rest=rest, path=path, modes=modes)

    @property
    def plant(self) -> Lti:
        """The sampled plant, its applied efforts among the outputs."""
        plant = sampled_plant(self.rest, self.path, applied=True)
        if not self.modes:
            return plant
        if self.rest.model.appendages.exact_reading is not None:
            raise BadInput("vary: mode.N is not for tips that read accelerations; vary stiffness")
        return with_modes(plant, states_of(self.rest.model), self.natural_modes, self.modes)

    @property
    def natural_modes(self) -> tuple[Mode, ...]:
        """Modes of the plant, the slowest first, as `analyse` lists them."""
        return natural_modes(continuous_plant(self.rest, self.path.actuator))


def situation_at(trial: Trial, point: Point) -> Situation:
    """Return where the plant of a trial is linear at a point."""
    return Situation(trial, trial.testbed, point.rest, point.path)
