"""A batch in flight: one law after another is active, each on an array of its sizes."""

from collections.abc import Callable, Sequence
from functools import partial, reduce
from itertools import pairwise
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.linear_form import LawForm, LinearForm
from flexslew_lab.metrics.settling import goal_displacement, settling_band
from flexslew_lab.studies.batch.benches.batch_friction import motion_of
from flexslew_lab.studies.batch.benches.judge import sensor_check_of
from flexslew_lab.studies.batch.benches.pushed import forces_of
from flexslew_lab.studies.batch.benches.senses import SensorBatch, filter_of, sensors_of
from flexslew_lab.studies.batch.groups.batch_laws import batch_laws, outputs_of
from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes, rows_of
from flexslew_lab.studies.batch.inputs import (
    disturbances_of,
    drives_of,
    errors_of,
    numbers_of,
    positions_of,
    tips_measured,
    wheel_rates_of,
)
from flexslew_lab.studies.batch.laws.beginning import beginning, combined
from flexslew_lab.studies.batch.laws.efforts import FlightNumbers, LawTerms
from flexslew_lab.studies.batch.laws.turned import rotation_joints_of
from flexslew_lab.studies.batch.laws.watch import Watch
from flexslew_lab.studies.batch.loop import Schedule, batch_loop
from flexslew_lab.studies.batch.stepped_loop import external_demand, step_loop
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds import initial_states
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, flat_zeros

_NONE = np.empty((0, 0, 0))
# rows that a law begins with; all others are handed on to the next one
_OF_THE_LAW = {"seen", "demand", "products", "held", "offset", "integral", "kp", "ki", "kd"}
_OF_THE_LAW |= {"law_limit"}


class LawSegment(NamedTuple):
    """A law in charge of a trial."""

    first: int  # tick from which on it is
    controller: str  # its name
    form: LinearForm
    transition_ticks: int  # ticks in which the efforts of the one before are blended out
    watch: Watch | None  # what its monitor allows; None: it has none


class FlightMode(NamedTuple):
    """How a group is flown."""

    recorded: bool  # whether the truth is recorded, see batch_loop
    displacement: float = 0.0  # added to all states in which the trials begin
    stepped: bool = False  # tick by tick, with actions from outside, see BatchFlight.parts


class BatchFlight:
    """Trials side by side, from tick 0 on.

    Args:
        members: the trials, BATCH_WIDTH of them.
        segments: of every trial, equal but for the numbers of the laws.
        gains: kp, ki and kd of the first laws, shape (BATCH_WIDTH, 3 axes).
        schedule: what is the same in every member.
        target: rows `tip` and `goal`, then the displacement of the plan.
        filled: how many trials there are; the others only fill up.
        mode: how it is flown.
    """

    def __init__(
        self,
        members: Sequence[BatchTrial],
        segments: Sequence[tuple[LawSegment, ...]],
        gains: Matrix,
        schedule: Schedule,
        target: Vector,
        filled: int,
        mode: FlightMode,
    ) -> None:
        self._mode, self.feedforward = mode, _NONE
        self._members, self._segments, self._schedule = list(members), segments[0], schedule
        self._filled = filled
        first, model = members[0], members[0].model
        laws = [batch_laws([of[k].form for of in segments]) for k in range(len(segments[0]))]
        names = [segment.controller for segment in self._segments]
        found = {  # by name: the loops do not depend on which is active first
            name: beginning(segment.form.observer, law.observers)
            for name, segment, law in sorted(
                zip(names, self._segments, laws, strict=True), key=itemgetter(0)
            )
        }
        self._observer = reduce(combined, found.values())
        self._start_ticks = {name: one.started for name, one in found.items()}
        self._charge = first.happens.charge
        if len(found) > 1:
            ends = np.cumsum([0, *(one.z.size // BATCH_WIDTH for one in found.values())]).tolist()
            places = dict(zip(found, ends, strict=False))
            laws = [
                law._replace(laws=[_expand_law(one, places[name], ends[-1]) for one in law.laws])
                for law, name in zip(laws, names, strict=True)
            ]
        self._laws = laws
        self._outputs = max(outputs_of(segment.form, model.joints) for segment in self._segments)
        self._instruments = sensors_of(members[:filled], laws[0], self._outputs - 2 * model.joints)
        self._push, self._external_forces = forces_of(members[:filled])
        self._move, self._friction = motion_of(members)
        self._drives = drives_of(self._members)
        self._errors = errors_of(self._members, self._outputs, len(schedule.time))
        self._disturbances = disturbances_of(members, filled, len(schedule.time) - 1)
        self._sensor_check = sensor_check_of(members)
        self._positions = positions_of(members, schedule)
        self._next = 0  # leg
        self._sizes = self._segment_sizes()
        self.rows = rows_of(first.kernel.size, self._sizes[0])
        self.w = self._at_rest(target, mode.displacement)
        self._begin(gains)

    def fallback_codes(self) -> Vector:
        """Return of every member 0, or why only the bench can fly it; see Rows.doubt."""
        if not self._sizes[0].doubtful:
            return np.zeros(BATCH_WIDTH)
        return self.w[self.rows.doubt : self.rows.doubt + BATCH_WIDTH]

    @property
    def parts(self) -> tuple[Any, ...]:
        """What step_loop gave for a flight that is stepped, then flight, w, z and memory."""
        loop: Any = self._loop
        return (loop.func, *loop.args)

    @property
    def instruments(self) -> SensorBatch | None:
        """The instruments; None: there are none, or no law reads them."""
        return self._instruments

    @property
    def quantised(self) -> bool:
        """Whether readings or motors are."""
        return self._sizes[0].quantised or self._sizes[0].discrete_effort

    def intervals(self, most: int) -> list[tuple[int, int]]:
        """Return all ticks in pieces that `fly` takes at once, no longer than `most`."""
        last, restarts = self._charge.last, (tick for tick, _ in self._charge.restarts)
        end = len(self._schedule.time) if last is None else last
        boundaries = sorted(
            {*range(0, end, most), *(segment.first for segment in self._segments), *restarts, end}
        )
        return list(pairwise(boundaries))

    def fly(self, first: int, last: int, record: Tensor = _NONE) -> None:
        """Fly from a tick to before another, all with one law; see batch_loop for the record."""
        for tick, name in self._charge.restarts:
            start_tick = self._start_ticks.get(name)
            if tick == first and start_tick is not None:
                start_tick[0] = tick
        if self._next < len(self._segments) and first == self._segments[self._next].first:
            self._activate_next()
        samples = _NONE if self._instruments is None else self._instruments.draw(last - first)
        self._loop(first, last, record, samples)

    def _activate_next(self) -> None:
        """Put the next law in charge."""
        before, w = self.rows, self.w
        size = self._members[0].kernel.size
        self.rows = rows_of(size, self._sizes[self._next])
        self.w = flat_zeros(self.rows.end)
        self.w[:size] = w[:size]
        ends = zip(Rows._fields[:-1], before, before[1:], self.rows, strict=False)
        for name, begin, end, at in ends:
            if name not in _OF_THE_LAW:
                self.w[at : at + end - begin] = w[begin:end]
        laws = self._laws[self._next].laws
        each = laws if len(laws) > 1 else laws * BATCH_WIDTH
        self._begin(np.array([law.gains for law in each]))

    def _begin(self, gains: Matrix) -> None:
        """Begin the next leg, which has its array."""
        segment, law, w, rows = (
            self._segments[self._next],
            self._laws[self._next],
            self.w,
            self.rows,
        )
        first, sizes, observer = self._members[0], self._sizes[self._next], self._observer
        w[rows.kp : rows.tip] = gains.T.ravel()
        limit = np.minimum(law.laws[0].integration.limit, np.finfo(float).max)
        w[rows.law_limit : rows.limit] = np.repeat(limit, BATCH_WIDTH)
        since = segment.first if self._next else -1
        position, velocity = self._positions, self._schedule.velocity
        if segment.form.shared is not None:
            position, velocity = (
                segment.form.shared.position[:, :, None],
                segment.form.shared.velocity,
            )
        numbers = numbers_of(law, position, velocity, since, segment.transition_ticks)
        if self._mode.stepped:
            self.feedforward = numbers.demand
            numbers = numbers._replace(demand=external_demand(*numbers.demand.shape[:2]))
        loop = (step_loop if self._mode.stepped else batch_loop)(
            first.kernel,
            sizes,
            LawTerms.of(numbers),
            observer.observe,
            self._push,
            self._move,
            filter_of(law),
        )
        flight = FlightNumbers(
            first.trial.period,
            first.steps,
            self._filled,
            self._schedule,
            self._disturbances,
            numbers,
            self._errors.noise,
            self._sensor_check,
            segment.watch,
            rotation_joints_of(first.model.attitude, first.model.joints),
            self._instruments and self._instruments.sensor_data,
            self._external_forces,
            self._friction,
            observer.constants,
        )
        self._loop: Callable[..., None] = partial(loop, flight, w, observer.z, observer.memory)
        self._next += 1

    def _segment_sizes(self) -> list[Sizes]:
        first, model, m = self._members[0], self._members[0].model, self._members[0].model.joints
        wheel_rates, motor = wheel_rates_of(self._members), first.trial.actuator
        has_pulse, discrete_effort = (
            self._drives[:, 2 * m : 3 * m].any(),
            self._drives[:, 3 * m].any(),
        )
        return [
            Sizes(
                m,
                model.modes,
                self._outputs,
                len(model.appendages.names),
                tips_measured(model.appendages.tip),
                segment.form.law.kp.size,
                segment.form.law.quadratic.size > 0,
                segment.form.shared is not None,
                bool(has_pulse),
                bool(motor.slew_rate),
                bool(motor.lag),
                bool(discrete_effort),
                bool(self._errors.quantum.any()),
                self._observer.z.size > 0,
                self._sensor_check is not None,
                segment.watch.innovations if segment.watch else 0,
                k > 0,
                self._disturbances.faults is not None,
                self._disturbances.disturbance.shape[2] > 1,
                wheel_rates,
                self._mode.recorded,
                model.attitude is not None,
                self._instruments is not None,
            )
            for k, segment in enumerate(self._segments)
        ]

    def _at_rest(self, target: Vector, displacement: float) -> Vector:
        """Return the array before tick 0."""
        members, rows, kernel = self._members, self.rows, self._members[0].kernel
        appendages, w = members[0].model.appendages, flat_zeros(rows.end)
        models = [member.model for member in members]
        packed = np.array([model.packed for model in models]).T
        state = initial_states([member.trial.testbed for member in members], models).T
        w[: kernel.size] = kernel.place(np.ascontiguousarray(packed))
        w[: state.size] = state.ravel() + displacement
        joints = members[0].model.joints
        w[rows.tip : rows.sign] = np.repeat(target[:-joints], BATCH_WIDTH)
        error = w[: joints * BATCH_WIDTH] - w[rows.goal : rows.sign]
        command = goal_displacement(target[-joints:], error.reshape(joints, BATCH_WIDTH).T)
        w[rows.sign : rows.band] = np.sign(command).T.ravel()
        w[rows.band : rows.law_limit] = settling_band(command).T.ravel()
        w[rows.limit : rows.bias] = self._drives.T.ravel()
        w[rows.bias : rows.quantum] = self._errors.bias.ravel()
        if rows.doubt > rows.quantum:
            w[rows.quantum : rows.doubt] = self._errors.quantum.ravel()
        if appendages.rate is not None:
            w[rows.tip_rate : rows.end] = np.repeat(appendages.rate, BATCH_WIDTH)
        w[rows.residual_tip : rows.peak_tip] = -np.inf
        return w


def _expand_law(law: LawForm, first: int, states: int) -> LawForm:
    """Return a law on the states of all observers, its own from `first` on."""

    def pad_weights(weights: Tensor) -> Any:
        trailing = states - first - weights.shape[-1]
        return np.pad(weights, [(0, 0)] * (weights.ndim - 1) + [(first, trailing)])

    return law._replace(
        from_state=pad_weights(law.from_state), to_integral=pad_weights(law.to_integral)
    )
