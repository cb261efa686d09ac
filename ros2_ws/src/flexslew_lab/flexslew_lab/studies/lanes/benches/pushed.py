"""What acts on lanes from outside, before and after each step: lane after lane as on the bench."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.compiled.push import Push, push_of


class LanePushes(NamedTuple):
    """What a push reads, a row for each lane; no rows where nothing acts from outside."""

    packed: Matrix  # numbers of the equations
    outside: Matrix  # numbers of the forces, see Outside


def pushes_of(lanes: Sequence[LaneTrial]) -> tuple[Callable[..., None], LanePushes]:
    """Return what pushes the lanes of a group (see `_pushing`), and what it reads."""
    model = lanes[0].model
    if model.outside is None:
        return _nothing, LanePushes(np.zeros((0, 0)), np.zeros((0, 0)))
    packed = np.array([lane.model.packed for lane in lanes])
    numbers = np.array([lane.model.outside.numbers for lane in lanes if lane.model.outside])
    sizes = model.positions + model.coordinates, model.coordinates, model.before_modes
    push = push_of(model.kernels, model.outside.add)
    return _pushing(push, *sizes), LanePushes(packed, numbers)


@compiled
def _nothing(t: float, span: float, pushes: LanePushes, filled: int, w: Vector) -> None:
    pass


@lru_cache
def _pushing(push: Push, states: int, coordinates: int, before: int) -> Callable[..., None]:
    """Return what gives lanes the impulse between t and t + span; see Model.pushed.

    It takes (t, span, LanePushes, number of lanes in use, w).

    Args:
        push: of the testbed.
        states: entries of [q, v].
        coordinates: of them v.
        before: of these before the modes.
    """

    @compiled
    def pushing(t: float, span: float, pushes: LanePushes, filled: int, w: Vector) -> None:
        x = np.empty(states)
        for lane in range(filled):
            for i in range(states):
                x[i] = w[i * LANES + lane]
            push(pushes.packed[lane], pushes.outside[lane], t, span, before, x)
            for i in range(states - coordinates, states):
                w[i * LANES + lane] = x[i]

    return cast(Callable[..., None], pushing)
