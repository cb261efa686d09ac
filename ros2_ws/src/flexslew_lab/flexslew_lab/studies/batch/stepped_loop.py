"""The compiled loop one tick at a time: what acts comes from outside, what is observed goes there.

The steps are those of `loop`, from the law of one tick to the readings of the next.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np
from numpy.lib.stride_tricks import as_strided

from flexslew_lab.studies.batch.benches.senses import Filter
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes, rows_of
from flexslew_lab.studies.batch.laws.efforts import FlightNumbers, LawTerms
from flexslew_lab.studies.batch.laws.observers import ObserverStep
from flexslew_lab.studies.batch.loop import batch_signals, loop_parts
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, vectorised
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, BatchKernel


class RunningTerms(NamedTuple):
    """Terms weight / (1 + value / half) of a score, of values that only grow during a flight."""

    first: Indices  # row of each value in the flat array, or of its first part
    parts: Indices  # how many it has
    added: Indices  # 1: the value is the sum of the parts; 0: the largest
    weight: Vector
    half: Vector


class StepGroup(NamedTuple):
    """A group of members between two ticks."""

    flight: FlightNumbers  # the demand of its law is that of external_demand
    w: Vector
    z: Vector
    memory: Vector
    feedforward: Tensor  # demand of the law itself, (ticks, joints, 1 or BATCH_WIDTH)
    effort: Matrix  # of the plan, (ticks, joints) [N m or N]
    record: Tensor  # as of batch_loop, of the ticks from `begin` on
    draws: Tensor  # of the instruments at the tick that comes, (1, members, draws)
    places: Indices  # of the filled members in the arrays of all
    score: Vector  # running score of each, (BATCH_WIDTH,)


class StepArrays(NamedTuple):
    """The arrays of all members; the first axis is for members."""

    actions: Matrix  # (members, joints) [-]
    observations: Matrix  # (members, size)
    rewards: Vector  # (members,)


def external_demand(ticks: int, joints: int) -> Tensor:
    """Return a demand for each member that is one row of memory at all ticks.

    So a loop for demands tick by tick reads what is written before each of them.
    """
    row = np.zeros((joints, BATCH_WIDTH))
    return as_strided(row, (ticks, joints, BATCH_WIDTH), (0, *row.strides))


@lru_cache
def step_loop(
    kernel: BatchKernel,
    sizes: Sizes,
    terms: LawTerms,
    observer_step: ObserverStep,
    push: Callable[..., None],
    move: Callable[..., None],
    filtered: Filter | None,
) -> Callable[..., None]:
    """Return the step of all groups with a testbed and a law of these sizes.

    It takes (groups, k, begin, span, RunningTerms, StepArrays): the actions act from tick k - 1 to
    k (k = 0: nothing acts), then tick k is read, observed and rewarded. An effort is that of the
    law plus span * limit * action. See batch_loop for the arguments of this function.
    """
    parts = loop_parts(kernel, sizes, terms, filtered)
    read_joints, metrics, read, set_in, compare = parts[:5]
    read_instruments, replace_positions, watch, efforts = parts[5:]
    signals_of, has_instruments = batch_signals(kernel, sizes), sizes.has_instruments
    rows = rows_of(kernel.size, sizes)
    set_demand, observe = _set_demand(rows, sizes), _observe(rows, sizes)

    @vectorised
    def act(k: int, span: float, actions: Matrix, group: StepGroup) -> None:
        flight, w = group.flight, group.w
        dt, filled = flight.dt, flight.filled
        set_demand(k, span, actions, group)
        efforts(k, flight.schedule.time[k], flight, group.z, w)
        push(k * dt, 0.5 * dt, flight.external_forces, filled, w)
        move(k * dt, dt, flight.steps, flight.friction, filled, w)
        push(k * dt + dt, -0.5 * dt, flight.external_forces, filled, w)

    @vectorised
    def sense(k: int, begin: int, group: StepGroup) -> None:
        flight, w, z, memory = group.flight, group.w, group.z, group.memory
        dt, filled, schedule = flight.dt, flight.filled, flight.schedule
        faults = flight.disturbances.faults
        read_joints(filled, w)
        metrics(k, begin, schedule, group.record, w)
        read(k, flight.noise, w)
        set_in(k, faults, w, filled)
        compare(k, dt, flight.sensor_check, w)
        if has_instruments:
            draws = group.draws[0], schedule.position[k], faults
            read_instruments(k, flight.instruments, *draws, w, filled)
        replace_positions(w, flight.rotation_joints, schedule.position[k], filled)
        observer_step(k, schedule.time[k], dt, flight.observer, signals_of(w), z, memory, filled)
        watch(k, flight.monitor, z, memory, w)

    @vectorised
    def step(
        groups: Sequence[StepGroup],
        k: int,
        begin: int,
        span: float,
        running: RunningTerms,
        arrays: StepArrays,
    ) -> None:
        for number in range(len(groups)):
            group = groups[number]
            if k > 0:
                act(k - 1, span, arrays.actions, group)
            sense(k, begin, group)
            observe(k, group, arrays.observations)
            _reward(running, group, arrays.rewards)

    return cast(Callable[..., None], step)


def _set_demand(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what adds the actions to the demand of the law."""
    m, limit = sizes.joints, rows.limit

    @vectorised
    def set_demand(k: int, span: float, actions: Matrix, group: StepGroup) -> None:
        demand, feedforward, places = group.flight.law.demand, group.feedforward, group.places
        unit = 1 if feedforward.shape[2] > 1 else 0
        for i in range(m):
            for member in range(BATCH_WIDTH):
                demand[0, i, member] = feedforward[k, i, member * unit]
            for member in range(places.size):
                action = min(max(actions[places[member], i], -1.0), 1.0)
                at = limit + i * BATCH_WIDTH + member
                demand[0, i, member] += span * group.w[at] * action

    return cast(Callable[..., None], set_demand)


def _observe(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return the compiled form of controllers.policy.observation, for all members of a group."""
    m, tips = sizes.joints, sizes.outputs - 2 * sizes.joints
    reading, applied, limit = rows.reading, rows.applied, rows.limit

    @vectorised
    def observe(k: int, group: StepGroup, observations: Matrix) -> None:
        w, schedule, effort = group.w, group.flight.schedule, group.effort
        position = group.flight.law.position
        for member in range(group.places.size):
            out = observations[group.places[member]]
            for i in range(m):
                at = i * BATCH_WIDTH + member
                tick, column = (0, member) if position.shape[2] > 1 else (k, 0)
                full = w[limit + at]
                out[i] = position[tick, i, column] - w[reading + at]
                out[m + i] = schedule.velocity[k, i] - w[reading + m * BATCH_WIDTH + at]
                out[2 * m + tips + i] = w[applied + at] / full
                out[3 * m + tips + i] = effort[k, i] / full
            for i in range(tips):
                out[2 * m + i] = w[reading + (2 * m + i) * BATCH_WIDTH + member]
            for i in range(out.size):
                out[i] = out[i] if abs(out[i]) < np.inf else 0.0

    return cast(Callable[..., None], observe)


@vectorised
def _reward(running: RunningTerms, group: StepGroup, rewards: Vector) -> None:
    """Write by how much the running score of each member has changed, and keep it."""
    w, score = group.w, group.score
    for member in range(group.places.size):
        total = 0.0
        for j in range(running.first.size):
            value = 0.0
            for i in range(running.parts[j]):
                part = w[running.first[j] + i * BATCH_WIDTH + member]
                value = value + part if running.added[j] else max(value, part)
            if value < np.inf:  # else it adds nothing, as what is no number
                total += running.weight[j] / (1.0 + value / running.half[j])
        rewards[group.places[member]] = total - score[member]
        score[member] = total
