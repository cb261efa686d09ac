"""Which controllers have no finite estimate at which ticks of a trial: known before the flight.

A sensor that reads NaN takes the estimate from whoever listens to it; with the first reading that
is a number again the estimator begins anew. Who listens is found by asking the controllers.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexslew_control.controllers.controller import Controller
from flexslew_lab.studies.lanes.groups.strikes import struck
from flexslew_lab.studies.ways import Way
from flexslew_plant.arrays import Vector
from flexslew_plant.faults import Timed
from flexslew_plant.faults.effects import Names
from flexslew_plant.faults.sensors import SensorDropout, SensorFreeze, SensorNan
from flexslew_plant.measurement import Measurement
from flexslew_plant.refusal import Cause
from flexslew_plant.testbeds.model import Model

Blindness: TypeAlias = Mapping[str, NDArray[np.bool_]]  # by controller, each (ticks,)
_ASKED = (False, True, True, False)  # whether the sensor reads NaN, tick by tick
_CHANNELS = ("joint_position", "joint_velocity", "tip_deflection", "root_curvature")


def unread(names: Names, faults: Sequence[Timed], seed: int, ticks: int) -> NDArray[np.bool_]:
    """Return at which ticks which sensors read NaN, shape (ticks, sensors of all channels).

    Args:
        names: joints and appendages.
        faults: of the trial.
        seed: of the trial.
        ticks: of the trial.
    """
    firsts = np.cumsum([0, *(len(names.of(channel)) for channel in _CHANNELS)])
    found = np.zeros((ticks, firsts[-1]), np.bool_)
    for timed in sorted(faults, key=lambda timed: timed.start):  # each changes what is there
        fault: Any = timed.fault
        if not isinstance(fault, SensorNan | SensorFreeze | SensorDropout):
            continue
        channel = _CHANNELS.index(fault.channel)
        first, last = firsts[channel : channel + 2]
        if fault.of is not None:
            first += names.of(fault.channel).index(fault.of)
            last = first + 1
        start, stop = timed.start, int(min(timed.end, ticks))
        if isinstance(fault, SensorNan):
            found[start:stop, first:last] = True
        elif isinstance(fault, SensorFreeze):
            found[start:stop, first:last] = found[start : start + 1, first:last]
        else:
            found[struck(timed, seed, ticks), first:last] = False
    return found


def blindness(
    controllers: Sequence[Controller], model: Model, x: Vector, unread: NDArray[np.bool_]
) -> Blindness | Way:
    """Return who is blind when; a way where only the bench can tell.

    Args:
        controllers: that take part in the trial, fresh.
        model: of the testbed.
        x: its state, for readings.
        unread: which sensors read NaN, see `unread`.
    """
    found = dict[str, NDArray[np.bool_]]()
    for controller in controllers:
        heard = np.zeros(unread.shape[1], np.bool_)
        for sensor in np.flatnonzero(unread.any(axis=0)).tolist():
            blind = _blinded(deepcopy(controller), model, x, sensor)
            if isinstance(blind, Way):
                return blind
            heard[sensor] = blind
        found[controller.name] = np.asarray(unread[:, heard].any(axis=1))
    return found


def _blinded(controller: Controller, model: Model, x: Vector, sensor: int) -> bool | Way:
    """Return whether a controller gives no answer for as long as a sensor reads NaN, and then does.

    A way where it is neither.
    """
    joints, tips = model.joints, np.zeros(len(model.appendages.names))
    position, velocity = model.joint_states(x[None])
    known, none = np.concatenate((position[0], velocity[0], tips, tips)), np.zeros(joints)
    found = list[bool]()
    for tick, wrong in enumerate(_ASKED):
        values = known.copy()
        values[sensor] = np.nan if wrong else known[sensor]
        q, v, tip, curvature = np.split(values, np.cumsum([joints, joints, tips.size]))
        time, name = tick * controller.period, controller.name
        answer = controller.observe(Measurement(tick, 0, time, name, q, v, tip, curvature, none))
        if answer is not None and not np.isfinite(answer.command.effort).all():
            return Way.NAN  # its law reads what its estimator does not
        reason = controller.reason
        if answer is None and (reason is None or reason.cause is not Cause.NOT_FINITE):
            return Way.NAN  # it cannot take charge for another reason
        found.append(answer is None)
    if not any(found):
        return False
    return True if found == list(_ASKED) else Way.NAN
