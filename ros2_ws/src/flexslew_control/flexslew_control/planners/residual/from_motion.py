"""The residual of a plan on a bench that moves before it begins, by a flight from that state."""

import numpy as np

from flexslew_control.analysis.linear_plant import PlantPath, motors
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.residual.motors import matrices
from flexslew_control.planners.residual.whole_bench import simulate_on_bench
from flexslew_control.planners.slew import known_motors
from flexslew_control.plans.known_motion import KnownMotion, with_motion
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Model

_MOST_TICKS = 50_000  # of the flight until the plan's end, of some 0.1 ms each


def predicted_from(
    motion: KnownMotion, plan: Plan, course: Plan, plant: PlantDescription, law: ActiveLaw
) -> Plan | None:
    """Return a plan with the residual that it leaves from a known state; None: no such flight.

    The law flies the equations of the bench from that state on, along the references before the
    plan, then along the plan.

    Args:
        motion: of the bench.
        plan: that is predicted from rest.
        course: the references from the tick of the motion on, those of the plan included.
        plant: the bench.
        law: that is active at the plan's start.
    """
    model = plant.testbed.model()
    fits = motion.modes.size == model.modes and plan.joint_names == model.joint_names
    if not fits or course.ticks > _MOST_TICKS:
        return None
    efforts = tuple(str(k) for k in range(plant.effort_limit.size))
    given = matrices(motors(PlantPath(plant.period, *known_motors(plant)), efforts))
    try:
        start = state_of(model, motion, course.position[0])
    except BadInput:  # no testbed at rest has these references
        return None
    found = simulate_on_bench(course, plant, law, motors=given, start=start)
    if found is None:
        return None
    errors = dict(zip(plan.joint_names, found.attitude_error.tolist(), strict=True))
    return with_motion(plan, found.tip_deflection, errors, course.start)


def state_of(model: Model, motion: KnownMotion, reference: Vector) -> Vector:
    """Return the state [q, v] of a testbed from the display of its joints and modes.

    A joint that is not displayed is at its reference, at rest. Of all velocities that the joints
    read so, the smallest are taken: a free platform does not drift.

    Args:
        model: equations of motion.
        motion: as displayed.
        reference: joint positions, shape (joints,) [rad or m]. The testbed is placed by these
            where the displayed ones are not positions at rest, as of a joint on an appendage.

    Raises:
        BadInput: if the references are not either.
    """
    named = dict(zip(model.joint_names, reference.tolist(), strict=True))
    joint_states = {name: motion.joints.get(name, (at, 0.0)) for name, at in named.items()}
    try:
        rest = model.rest({name: at for name, (at, _) in joint_states.items()})
    except BadInput:
        rest = model.rest(named)
    x = np.concatenate((rest, np.zeros(model.coordinates)))
    modes, rates = model.modal_state(x)  # views
    modes[:], rates[:] = motion.modes, motion.rates
    by_modes = model.joint_state(x)[1].copy()
    before = slice(model.positions, model.positions + model.before_modes)
    columns = np.empty((model.joints, model.before_modes))
    for k in range(model.before_modes):  # a joint's rate is linear in the velocities
        shifted = x.copy()
        shifted[before.start + k] += 1.0
        columns[:, k] = model.joint_state(shifted)[1] - by_modes
    missing = np.array([rate for _, rate in joint_states.values()]) - by_modes
    x[before] = np.linalg.lstsq(columns, missing, rcond=None)[0]
    return x
