"""External forces on the members before and after each step, as on the bench."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_plant.arrays import Matrix, Vector, compiled, put
from flexslew_plant.testbeds.compiled.batch_kernel import member_rows, skip
from flexslew_plant.testbeds.compiled.push import Push, push_of


class BatchForces(NamedTuple):
    """What a push reads, a row for each member; no rows where nothing acts from outside."""

    packed: Matrix  # numbers of the equations
    outside: Matrix  # numbers of the forces, see Outside


def forces_of(members: Sequence[BatchTrial]) -> tuple[Callable[..., None], BatchForces]:
    """Return what pushes the members of a group (see `_force_step`), and what it reads."""
    model = members[0].model
    if model.outside is None:
        return skip, BatchForces(np.zeros((0, 0)), np.zeros((0, 0)))
    packed = np.array([member.model.packed for member in members])
    numbers = np.array([member.model.outside.numbers for member in members if member.model.outside])
    push, states = push_of(model.kernels, model.outside.add), model.positions + model.coordinates
    return _force_step(push, states, model.before_modes), BatchForces(packed, numbers)


@lru_cache
def _force_step(push: Push, states: int, before: int) -> Callable[..., None]:
    """Return what gives members the impulse between t and t + span; see Model.pushed.

    It takes (t, span, BatchForces, number of members in use, w).

    Args:
        push: of the testbed.
        states: entries of [q, v].
        before: coordinates before the modes.
    """

    @compiled
    def apply_forces(t: float, span: float, forces: BatchForces, filled: int, w: Vector) -> None:
        x = np.empty(states)
        for member in range(filled):
            put(member_rows(w, 0, states, member), x)
            push(forces.packed[member], forces.outside[member], t, span, before, x)
            put(x, member_rows(w, 0, states, member))

    return cast(Callable[..., None], apply_forces)
