"""A group of lanes in flight: one law after another is in charge, each on an array of its sizes."""

from collections.abc import Callable, Sequence
from functools import partial, reduce
from itertools import pairwise
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.linear_form import LawForm, LinearForm
from flexslew_lab.metrics.settling import commanded_moves, settling_band
from flexslew_lab.studies.lanes.benches.judge import judge_of
from flexslew_lab.studies.lanes.benches.lane_friction import movement_of
from flexslew_lab.studies.lanes.benches.pushed import pushes_of
from flexslew_lab.studies.lanes.benches.senses import filter_of, heard_by
from flexslew_lab.studies.lanes.groups.lane_laws import beside, outputs_of
from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes, rows_of
from flexslew_lab.studies.lanes.inputs import (
    drives_of,
    errors_of,
    numbers_of,
    positions_of,
    quanta_of,
    spun_by,
    tips_measured,
    troubles_of,
)
from flexslew_lab.studies.lanes.laws.beginning import Beginning, beginning
from flexslew_lab.studies.lanes.laws.efforts import LawTerms
from flexslew_lab.studies.lanes.laws.observers import one_after_another
from flexslew_lab.studies.lanes.laws.turned import turned_joints
from flexslew_lab.studies.lanes.laws.watch import Watch
from flexslew_lab.studies.lanes.loop import Schedule, lane_loop
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.testbeds import initial_states
from flexslew_plant.testbeds.compiled.lanes import LANES, flat_zeros

_NONE = np.empty((0, 0, 0))
# rows that a law begins with; all others are handed on to the next one
_OF_THE_LAW = {"seen", "demand", "products", "held", "offset", "integral", "kp", "ki", "kd"}
_OF_THE_LAW |= {"law_limit"}


class Leg(NamedTuple):
    """A law in charge of a trial."""

    first: int  # tick from which on it is
    controller: str  # its name
    form: LinearForm
    blended: int  # ticks in which the efforts of the one before are blended out
    watch: Watch | None  # what its monitor allows; None: it has none


class LaneFlight:
    """Trials side by side, from tick 0 on.

    Args:
        lanes: the trials, LANES of them.
        legs: of every trial, equal but for the numbers of the laws.
        gains: kp, ki and kd of the first laws, shape (LANES, 3 axes).
        schedule: what is the same in every lane.
        aim: rows `tip` and `goal`, then the displacement of the plan.
        filled: how many trials there are; the others only fill up.
        recorded: whether the truth is, see lane_loop.
        moved: added to all states in which the trials begin.
    """

    def __init__(
        self,
        lanes: Sequence[LaneTrial],
        legs: Sequence[tuple[Leg, ...]],
        gains: Matrix,
        schedule: Schedule,
        aim: Vector,
        filled: int,
        recorded: bool,
        moved: float = 0.0,
    ) -> None:
        self._lanes, self._legs, self._schedule = list(lanes), legs[0], schedule
        self._filled, self._recorded = filled, recorded
        first, model = lanes[0], lanes[0].model
        laws = [beside([of[k].form for of in legs]) for k in range(len(legs[0]))]
        names = [leg.controller for leg in self._legs]
        found = {  # by name: the loops do not depend on which is active first
            name: beginning(leg.form.observer, law.observers)
            for name, leg, law in sorted(
                zip(names, self._legs, laws, strict=True), key=itemgetter(0)
            )
        }
        self._observer = reduce(_in_sequence, found.values())
        self._begun = {name: one.begun for name, one in found.items()}
        self._charge = first.happens.charge
        if len(found) > 1:
            ends = np.cumsum([0, *(one.z.size // LANES for one in found.values())]).tolist()
            places = dict(zip(found, ends, strict=False))
            laws = [
                law._replace(laws=[_among(one, places[name], ends[-1]) for one in law.laws])
                for law, name in zip(laws, names, strict=True)
            ]
        self._laws = laws
        self._outputs = max(outputs_of(leg.form, model.joints) for leg in self._legs)
        self._heard = heard_by(lanes[:filled], laws[0], self._outputs - 2 * model.joints)
        self._push, self._pushes = pushes_of(lanes[:filled])
        self._move, self._friction = movement_of(lanes)
        self._drives = drives_of(self._lanes)
        self._errors = errors_of(self._lanes, self._outputs, len(schedule.time))
        self._troubles = troubles_of(lanes, filled, len(schedule.time) - 1)
        self._quanta = quanta_of(self._lanes, self._outputs)
        self._judge = judge_of(lanes)
        self._positions = positions_of(lanes, schedule)
        self._next = 0  # leg
        self._sizes = self._sizes_of_legs()
        self.rows = rows_of(first.kernel.size, self._sizes[0])
        self.w = self._at_rest(aim, moved)
        self._begin(gains)

    def in_doubt(self) -> Vector:
        """Return of every lane 0, or why only the bench can fly it; see Rows.doubt."""
        if not self._sizes[0].doubtful:
            return np.zeros(LANES)
        return self.w[self.rows.doubt : self.rows.doubt + LANES]

    @property
    def quantised(self) -> bool:
        """Whether readings or motors are."""
        return self._sizes[0].quantised or self._sizes[0].stepped

    def cuts(self, most: int) -> list[tuple[int, int]]:
        """Return all ticks in pieces that `fly` takes at once, no longer than `most`."""
        last, restarts = self._charge.last, (tick for tick, _ in self._charge.restarts)
        end = len(self._schedule.time) if last is None else last
        cuts = sorted({*range(0, end, most), *(leg.first for leg in self._legs), *restarts, end})
        return list(pairwise(cuts))

    def fly(self, first: int, last: int, record: Tensor = _NONE) -> None:
        """Fly from a tick to before another, all with one law; see lane_loop for the record."""
        for tick, name in self._charge.restarts:
            begun = self._begun.get(name)
            if tick == first and begun is not None:
                begun[0] = tick
        if self._next < len(self._legs) and first == self._legs[self._next].first:
            self._hand_over()
        drawn = _NONE if self._heard is None else self._heard.drawn(last - first)
        self._loop(first, last, record, drawn)

    def _hand_over(self) -> None:
        """Put the next law in charge."""
        before, w = self.rows, self.w
        size = self._lanes[0].kernel.size
        self.rows = rows_of(size, self._sizes[self._next])
        self.w = flat_zeros(self.rows.end)
        self.w[:size] = w[:size]
        ends = zip(Rows._fields[:-1], before, before[1:], self.rows, strict=False)
        for name, begin, end, at in ends:
            if name not in _OF_THE_LAW:
                self.w[at : at + end - begin] = w[begin:end]
        laws = self._laws[self._next].laws
        each = laws if len(laws) > 1 else laws * LANES
        self._begin(np.array([law.gains for law in each]))

    def _begin(self, gains: Matrix) -> None:
        """Begin the next leg, which has its array."""
        leg, law, w, rows = self._legs[self._next], self._laws[self._next], self.w, self.rows
        first, sizes, observer = self._lanes[0], self._sizes[self._next], self._observer
        w[rows.kp : rows.tip] = gains.T.ravel()
        limit = np.minimum(law.laws[0].limit, np.finfo(float).max)
        w[rows.law_limit : rows.limit] = np.repeat(limit, LANES)
        since = leg.first if self._next else -1
        position, velocity = self._positions, self._schedule.velocity
        if leg.form.shared is not None:
            position, velocity = leg.form.shared.position[:, :, None], leg.form.shared.velocity
        numbers = numbers_of(law, position, velocity, since, leg.blended)
        attitude, heard = first.model.attitude, self._heard
        kinds = self._recorded, attitude is not None, heard is not None, filter_of(law)
        terms = LawTerms.of(numbers)
        loop = lane_loop(
            first.kernel, sizes, terms, observer.observe, self._push, self._move, *kinds
        )
        self._loop: Callable[..., None] = partial(
            loop,
            w,
            first.trial.period,
            first.steps,
            self._schedule,
            self._troubles,
            numbers,
            self._errors,
            self._judge,
            leg.watch,
            turned_joints(attitude, first.model.joints),
            heard and heard.senses,
            self._pushes,
            self._friction,
            observer.constants,
            observer.z,
            observer.memory,
            self._filled,
        )
        self._next += 1

    def _sizes_of_legs(self) -> list[Sizes]:
        first, model, m = self._lanes[0], self._lanes[0].model, self._lanes[0].model.joints
        spun, motor = spun_by(self._lanes), first.trial.actuator
        pulsed, stepped = self._drives[:, 2 * m : 3 * m].any(), self._drives[:, 3 * m].any()
        return [
            Sizes(
                m,
                model.modes,
                self._outputs,
                len(model.appendages.names),
                tips_measured(model.appendages.tip),
                leg.form.law.kp.size,
                leg.form.law.quadratic.size > 0,
                leg.form.shared is not None,
                bool(pulsed),
                bool(motor.slew_rate),
                bool(motor.lag),
                bool(stepped),
                bool(self._quanta.any()),
                self._observer.z.size > 0,
                self._judge is not None,
                leg.watch.innovations if leg.watch else 0,
                k > 0,
                self._troubles.faults is not None,
                self._troubles.disturbance.shape[2] > 1,
                spun,
            )
            for k, leg in enumerate(self._legs)
        ]

    def _at_rest(self, aim: Vector, moved: float) -> Vector:
        """Return the array before tick 0."""
        lanes, rows, kernel = self._lanes, self.rows, self._lanes[0].kernel
        appendages, w = lanes[0].model.appendages, flat_zeros(rows.end)
        models = [lane.model for lane in lanes]
        packed = np.array([model.packed for model in models]).T
        state = initial_states([lane.trial.testbed for lane in lanes], models).T
        w[: kernel.size] = kernel.place(np.ascontiguousarray(packed))
        w[: state.size] = state.ravel() + moved
        joints = lanes[0].model.joints
        w[rows.tip : rows.sign] = np.repeat(aim[:-joints], LANES)
        error = w[: joints * LANES] - w[rows.goal : rows.sign]
        moves = commanded_moves(aim[-joints:], error.reshape(joints, LANES).T)
        w[rows.sign : rows.band] = np.sign(moves).T.ravel()
        w[rows.band : rows.law_limit] = settling_band(moves).T.ravel()
        w[rows.limit : rows.quantum] = self._drives.T.ravel()
        if rows.doubt > rows.quantum:
            w[rows.quantum : rows.doubt] = self._quanta.ravel()
        if appendages.rate is not None:
            w[rows.tip_rate : rows.end] = np.repeat(appendages.rate, LANES)
        w[rows.outside : rows.terminal] = -np.inf
        return w


def _in_sequence(first: Beginning, then: Beginning) -> Beginning:
    """Return two observers as one."""
    return Beginning(
        one_after_another(first.observe, first.z.size, first.memory.size, then.observe),
        (first.constants, then.constants),
        np.concatenate((first.z, then.z)),
        np.concatenate((first.memory, then.memory)),
    )


def _among(law: LawForm, first: int, states: int) -> LawForm:
    """Return a law on the states of all observers, its own from `first` on."""

    def wider(weights: Tensor) -> Any:
        behind = states - first - weights.shape[-1]
        return np.pad(weights, [(0, 0)] * (weights.ndim - 1) + [(first, behind)])

    return law._replace(from_state=wider(law.from_state), to_integral=wider(law.to_integral))
