"""The linear form of a controller, taken from its running code.

A controller at rest is copied, what it measures and what it remembers is perturb, and the copies
answer one tick: differences of fourth order of its answer and of its memory are the matrices of
    s(k + 1) = A s(k) + B w(k), u(k) = C s(k) + D w(k).
The memory s is what differs between two copies that have measured different things, as far as it
acts on a later effort: a filter's covariance, which does not to first order, is left out.
"""

from dataclasses import dataclass

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.numeric_state import Place, assign, copied, numbers
from flexslew_control.analysis.rest import Rest
from flexslew_control.analysis.signals import applied_of, inputs_of, outputs_of
from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.probing.probed_controller import (
    ProbeController,
    from_flat,
    memory_parts,
)
from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.estimators.instrument_readings import with_sensors
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

REFERENCE = "reference"  # of a joint's position, an input of the form

_CLOSE = 0.02  # mismatch of the two at small motions, of the largest effort
_KEPT = 1e-5  # mismatch then, of the largest effort: beyond it something may be kept elsewhere
# Motions, of those before, at which such a mismatch is looked at again: what is kept elsewhere is
# as large a part as before, what is not linear is smaller by as much; a part from which it is kept.
_REDUCTION, _AS_BEFORE = 0.01, 0.1


@dataclass(frozen=True)
class RunningLaw:
    """A controller as matrices.

    Args:
        form: from measurement, `applied.JOINT` and `reference.JOINT` to `effort.JOINT`.
        mismatch: largest difference between form and code over some ticks of small motions,
            of the largest effort [-].
        ticks: after which its memory had settled at rest.
        steady_controller: a copy that has answered the ticks before that one, its references at
            the rest.
        memory: where the states of the form stand in it.
    """

    form: Lti
    mismatch: float
    ticks: int
    steady_controller: Controller
    memory: tuple[Place, ...]

    def perturb(self, s: Vector) -> Controller:
        """Return a copy of the rested controller with its memory away from its rest by s."""
        one: Controller = copied(self.steady_controller)
        parts = memory_parts(one)
        values = numbers(parts)
        flat = np.concatenate([np.ravel(values[place]) for place in self.memory] + [np.zeros(0)])
        for place, value in from_flat(values, self.memory, flat + s).items():
            assign(parts, place, value)
        return one


def running_law(
    controller: Controller, rest: Rest, limit: Vector, gains: Vector | None = None
) -> RunningLaw:
    """Return the linear form of a controller about a rest.

    Time stands still at the rest's, so that what turns is frozen; limits of the law do not act.

    Args:
        controller: as built; it stays as it is.
        rest: about which.
        limit: of the efforts, shape (efforts,).
        gains: of a law that takes them from its plan, at that time; None: none.

    Raises:
        BadInput: it gives no answer at rest, or is not linear there.
    """
    if isinstance(controller.estimator, AttitudeEstimator):
        sensors = with_sensors(controller.estimator)
        controller = copied(controller)
        controller.use_estimator(sensors)
    probe = ProbeController(controller, rest, limit, gains)
    probe.settle()
    memory = probe.memory()
    a, b, c, d = probe.slopes(memory)
    model = rest.model
    names = (*outputs_of(model), *applied_of(model))
    references = tuple(f"{REFERENCE}.{joint}" for joint in model.joint_names)
    form = Lti(
        a, b, c, d, (*names, *references), inputs_of(model), _names(probe, memory),
        controller.period,
    )  # fmt: skip
    mismatch, kept = probe.mismatch(form)
    if (
        mismatch < _CLOSE
        and not kept < _KEPT
        and not probe.mismatch(form, _REDUCTION)[1] < _AS_BEFORE * kept
    ):
        raise BadInput(
            f"{controller.name} keeps memory outside of itself: at rest after small motions its "
            f"efforts differ by {100.0 * kept:.2g} % of the largest from those of its linear form; "
            "allowed: floats and arrays of float64 in the law or its estimator"
        )
    if not mismatch < _CLOSE:
        raise BadInput(
            f"{controller.name} is not linear at this rest: its efforts differ by "
            f"{100.0 * mismatch:.2g} % from those of its linear form; it may limit its efforts here"
            " (of drives that push one way: take another time by --at, or give the law an "
            "`allocation`), or keep its memory outside of itself"
        )
    return RunningLaw(form, mismatch, probe.tick, probe.controller, tuple(memory))


def _names(probe: ProbeController, memory: list[Place]) -> tuple[str, ...]:
    out = []
    for place in memory:
        name = ".".join(str(part).lstrip("_") for part in place)
        out += [f"{name}.{k + 1}" for k in range(np.size(probe.held[place]))]
    return tuple(out)
