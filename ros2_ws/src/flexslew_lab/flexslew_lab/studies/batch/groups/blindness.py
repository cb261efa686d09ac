"""Which controllers have no finite estimate at which ticks of a trial: known before the flight.

A sensor that reads NaN takes the estimate from each controller that reads it; with the first
reading that is a number again the estimator starts again. Each controller gives the channels that
it reads.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexslew_control.controllers.controller import Controller
from flexslew_lab.studies.batch.groups.strikes import active_ticks
from flexslew_lab.studies.ways import Way
from flexslew_plant.arrays import Vector
from flexslew_plant.faults import Timed
from flexslew_plant.faults.dispatch import advance_fault, number_of
from flexslew_plant.faults.effects import Names
from flexslew_plant.faults.steps import Where
from flexslew_plant.hardware.sensors import Readings, channel_bounds
from flexslew_plant.measurement import Measurement
from flexslew_plant.refusal import Cause
from flexslew_plant.testbeds.model import Model

EstimateLoss: TypeAlias = Mapping[str, NDArray[np.bool_]]  # by controller, each (ticks,)
_TEST_SEQUENCE = (False, True, True, False)  # whether the sensor reads NaN, tick by tick


def find_invalid(names: Names, faults: Sequence[Timed], seed: int, ticks: int) -> NDArray[np.bool_]:
    """Return at which ticks which sensors read NaN, shape (ticks, sensors of all channels).

    Args:
        names: joints and appendages.
        faults: of the trial.
        seed: of the trial.
        ticks: of the trial.
    """
    first_index = channel_bounds(len(names.joints), len(names.appendages))
    values, advance = np.zeros((ticks, first_index[-1])), advance_fault()
    for timed in sorted(faults, key=lambda timed: timed.start):  # each changes what is there
        fault: Any = timed.fault
        kind = number_of(fault)
        action = None if kind is None else fault.action(names)
        if action is None or action.where is not Where.READING:
            continue
        first = first_index[Readings._fields.index(action.channel)]
        columns = slice(first + action.first, first + action.last)
        span = slice(timed.start, int(min(timed.end, ticks)))
        read = np.ascontiguousarray(values[span, columns])
        memory = np.zeros((action.last - action.first) * action.memory)
        active = active_ticks(timed, seed, ticks)[span]
        advance(kind, np.array(action.numbers, dtype=np.float64), memory, 0, active, read)
        values[span, columns] = read
    return np.isnan(values)


def estimate_loss(
    controllers: Sequence[Controller], model: Model, x: Vector, invalid: NDArray[np.bool_]
) -> EstimateLoss | Way:
    """Return which controller is blind at which ticks; a way if only the bench can find it.

    Args:
        controllers: that take part in the trial, fresh.
        model: of the testbed.
        x: its state, for readings.
        invalid: which sensors read NaN, see `invalid`.
    """
    found = dict[str, NDArray[np.bool_]]()
    for controller in controllers:
        required = np.zeros(invalid.shape[1], np.bool_)
        for sensor in np.flatnonzero(invalid.any(axis=0)).tolist():
            lost = _without_estimate(deepcopy(controller), model, x, sensor)
            if isinstance(lost, Way):
                return lost
            required[sensor] = lost
        found[controller.name] = np.asarray(invalid[:, required].any(axis=1))
    return found


def _without_estimate(controller: Controller, model: Model, x: Vector, sensor: int) -> bool | Way:
    """Return whether a controller gives no answer for as long as a sensor reads NaN, and then does.

    A way where it is neither.
    """
    joints, tips = model.joints, np.zeros(len(model.appendages.names))
    position, velocity = model.joint_states(x[None])
    known, none = np.concatenate((position[0], velocity[0], tips, tips)), np.zeros(joints)
    found = list[bool]()
    for tick, wrong in enumerate(_TEST_SEQUENCE):
        values = known.copy()
        values[sensor] = np.nan if wrong else known[sensor]
        q, v, tip, curvature = np.split(values, channel_bounds(joints, tips.size)[1:-1])
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
    return True if found == list(_TEST_SEQUENCE) else Way.NAN
