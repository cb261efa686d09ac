"""The observer of small motions in lanes: it predicts with the equations of motion."""

from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_control.estimators.small_motion_observer import MotionBelief, take_in
from flexslew_control.linear_form import LinearObserver
from flexslew_lab.studies.lanes.laws.observers import LaneSignals, Observe, linear
from flexslew_plant.arrays import Indices, Vector, compiled, put
from flexslew_plant.testbeds.compiled import interface
from flexslew_plant.testbeds.compiled.bound import bound
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.kernels import Kernels


class LaneMotions(NamedTuple):
    """What linear_form.SmallMotionForm holds, of the lanes side by side."""

    beliefs: MotionBelief  # an axis for lanes in front; one entry: the same in all
    behind: LinearObserver  # by lane_laws.by_lane


@lru_cache
def small_motions(kernels: Kernels, n: int, before: int, behind: int) -> Observe:
    """Return the observer of small motions and what reads its estimate, lane after lane.

    Its memory holds [q, v] of every lane, then rows: the estimates of the tick before, and what
    the one behind keeps.

    Args:
        kernels: the equations that it believes in.
        n: coordinates.
        before: of them before the modes.
        behind: states of the one behind.
    """
    advance, read_estimate = bound(kernels, n, before).advance, linear(behind)
    rows = 2 * n * LANES  # of an estimate

    @compiled
    def observe(
        k: int,
        t: float,
        dt: float,
        given: tuple[Indices, LaneMotions],
        signals: LaneSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        begun, motions = given
        beliefs = motions.beliefs
        positions, outputs = beliefs.rest.shape[1], beliefs.gain.shape[2]
        m, each, unit = outputs // 2, positions + n, 1 if len(beliefs.rest) > 1 else 0
        held, innovation, found = np.empty(m), np.empty(outputs), np.empty(2 * n)
        earlier, after = memory[each * LANES : each * LANES + rows], memory[each * LANES + rows :]
        put(z[:rows], earlier)
        for lane in range(filled):
            packed, rest = beliefs.packed[lane * unit], beliefs.rest[lane * unit]
            gain, small = beliefs.gain[lane * unit], beliefs.small[lane * unit]
            x = memory[lane * each : (lane + 1) * each]
            if k == 0:
                put(rest, x)
                x[positions:] = 0.0
            else:
                for i in range(m):
                    held[i] = signals.effort[i * LANES + lane]
                advance(packed, t - dt, held, dt, 1, before, x)
            interface.reading(kernels, packed, x, innovation[:m], innovation[m:])
            for i in range(outputs):
                innovation[i] = signals.y[i * LANES + lane] - innovation[i]
            take_in(kernels, packed, gain, rest, small, innovation, x, found)
            for i in range(2 * n):
                z[i * LANES + lane] = found[i]
        seen = LaneSignals(z[:rows], earlier, signals.effort, signals.demand)
        read_estimate(k, t, dt, (begun, motions.behind), seen, z[rows:], after, filled)

    return cast(Observe, observe)
