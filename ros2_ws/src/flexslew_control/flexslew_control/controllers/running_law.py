"""The linear form of a controller, taken from its running code.

A controller at rest is copied, what it measures and what it remembers is perturbed, and the copies
answer one tick: differences of fourth order of its answer and of its memory are the matrices of
    s(k + 1) = A s(k) + B w(k), u(k) = C s(k) + D w(k).
The memory s is what differs between two copies that have measured different things, as far as it
acts on a later effort: a filter's covariance, which does not to first order, is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.nonlinear_plant import readings
from flexslew_control.analysis.numeric_state import Number, Place, assign, copied, numbers
from flexslew_control.analysis.rest import Rest
from flexslew_control.analysis.signals import applied_of, inputs_of, outputs_of
from flexslew_control.controllers.controller import Controller
from flexslew_control.course import Course
from flexslew_control.estimators.attitude_estimator import AttitudeEstimator
from flexslew_control.law import Reference
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

REFERENCE = "reference"  # of a joint's position, an input of the form

_SETTLED = 1e-9  # change of a number in 100 ticks, of its size
_MOST_TICKS = 20_000  # until it must have settled
_SOON = 1_000  # ticks after which what settles slowly is taken ahead
_DOUBLINGS = 24  # of a tick: two days of them at 100 Hz
_TO_THE_END = 40  # doublings after which every covariance stands still that has a limit
_HAS_A_LIMIT = 0.01  # of what it is after two days: what is less by then goes to nothing
_EXCITED = 8  # ticks in which two copies measure different things
_PROBE = 1e-6  # of a number that is zero at rest
_SHARE = 1e-3  # of the effort limits that a perturbation may ask for
_NO_EFFECT = 1e-11  # of a perturbation: rounding
_CHECKED = 60  # ticks in which form and code are compared
_CLOSE = 0.02  # mismatch of the two at small motions, of the largest effort
_STILL = 20  # ticks at rest after them
_KEPT = 1e-5  # mismatch then, of the largest effort: beyond it something may be kept elsewhere
# Motions, of those before, at which such a mismatch is looked at again: what is kept elsewhere is
# as large a part as before, what is not linear is smaller by as much; a part from which it is kept.
_SMALLER, _AS_BEFORE = 0.01, 0.1


@runtime_checkable
class SettlesSlowly(Protocol):
    """An estimator whose covariance may take longer than ticks can be flown."""

    def settle(self, doublings: int) -> Matrix:
        """Let the covariance become that of 2^doublings ticks later at rest, and return it."""


@dataclass(frozen=True)
class RunningLaw:
    """A controller as matrices.

    Args:
        form: from measurement, `applied.JOINT` and `reference.JOINT` to `effort.JOINT`.
        mismatch: largest difference between form and code over some ticks of small motions,
            of the largest effort [-].
        ticks: after which its memory had settled at rest.
        rested: a copy that has answered the ticks before that one, its references at the rest.
        memory: where the states of the form stand in it.
    """

    form: Lti
    mismatch: float
    ticks: int
    rested: Controller
    memory: tuple[Place, ...]

    def moved(self, s: Vector) -> Controller:
        """Return a copy of the rested controller whose memory is away from its rest by s."""
        one: Controller = copied(self.rested)
        parts = _parts(one)
        held = numbers(parts)
        flat = np.concatenate([np.ravel(held[place]) for place in self.memory] + [np.zeros(0)])
        for place, value in _placed(held, self.memory, flat + s).items():
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
        raise BadInput(
            f"{controller.name} finds its attitude by instruments, whose readings come late and "
            "are no deviations: it has no linear form; allowed: the same law without `attitude`"
        )
    desk = _Desk(controller, rest, limit, gains)
    desk.settle()
    memory = desk.memory()
    a, b, c, d = desk.slopes(memory)
    model = rest.model
    names = (*outputs_of(model), *applied_of(model))
    references = tuple(f"{REFERENCE}.{joint}" for joint in model.joint_names)
    form = Lti(
        a, b, c, d, (*names, *references), inputs_of(model), _names(desk, memory),
        controller.period,
    )  # fmt: skip
    mismatch, kept = desk.mismatch(form)
    if (
        mismatch < _CLOSE
        and not kept < _KEPT
        and not desk.mismatch(form, _SMALLER)[1] < _AS_BEFORE * kept
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
            " or keep its memory outside of itself"
        )
    return RunningLaw(form, mismatch, desk.tick, desk.controller, tuple(memory))


def _settle(estimator: SettlesSlowly) -> None:
    """Take a covariance to its limit; where it has none that is not zero, to that of two days."""
    later: SettlesSlowly = copied(estimator)
    limit = np.diag(later.settle(_TO_THE_END))
    days = np.diag(estimator.settle(_DOUBLINGS))
    if (limit >= _HAS_A_LIMIT * days).all():
        estimator.settle(_TO_THE_END)


def _parts(controller: Controller) -> dict[str, Any]:
    """Return what a controller remembers in."""
    return {"estimator": controller.estimator, "law": controller.law}


def _placed(
    held: dict[Place, Number], memory: Sequence[Place], flat: Vector
) -> dict[Place, Number]:
    """Return the numbers of a flat vector by place, in the shapes of those that are held."""
    out: dict[Place, Number] = {}
    at = 0
    for place in memory:
        value = held[place]
        part = flat[at : at + np.size(value)]
        at += part.size
        out[place] = float(part[0]) if np.isscalar(value) else part.reshape(np.shape(value))
    return out


def _names(desk: "_Desk", memory: list[Place]) -> tuple[str, ...]:
    out = []
    for place in memory:
        name = ".".join(str(part).lstrip("_") for part in place)
        out += [f"{name}.{k + 1}" for k in range(np.size(desk.held[place]))]
    return tuple(out)


class _Desk:
    """A controller that is asked the questions of a rest."""

    def __init__(
        self, controller: Controller, rest: Rest, limit: Vector, gains: Vector | None
    ) -> None:
        self._limit, self._m = limit, rest.model.joints
        self._time = rest.time
        self._read = np.concatenate((readings(rest.model, rest.state, rest.effort, rest.time),
                                     rest.effort))  # fmt: skip
        self._appendages = len(rest.model.appendages.names)
        self._gains = np.zeros(0) if gains is None else gains
        self._effort = rest.effort
        self._attitude = rest.model.attitude
        self.controller: Controller = copied(controller)
        self._rest = self._course(np.zeros(self._m))
        self.controller.steer(self._rest)
        self._follows = self._takes_references()
        self.tick = 0
        self.held: dict[Place, Number] = {}
        self._constant: dict[Place, Number] = {}

    @property
    def inputs(self) -> int:
        """How many numbers it measures, with the references."""
        return self._read.size + self._m

    def _course(self, moved: Vector) -> Course:
        """Return what rests for ever, its position moved."""
        m, held = self._m, self.controller
        still, there = np.zeros((2, m)), np.tile(self._positions(moved), (2, 1))
        gains = np.tile(self._gains, (2, 1)) if self._gains.size else np.zeros((0, 0))
        plan = Plan(
            "none", held.joint_names, 0.0, held.period, there, still, self._effort[None],
            np.zeros((2, 0)), 0.0, gains,
        )  # fmt: skip
        return cast(Course, _Held(plan, plan.reference(0)))

    def _positions(self, moved: Vector) -> Vector:
        """Return positions that are off the rest by this, shape (joints,).

        Of joints that read an attitude it is the rotation from the rest, as in linear_plant.
        """
        at = self._read[: self._m]
        if self._attitude is None or not self._attitude.turn_of(at).any():
            return at + moved
        return self._attitude.moved(at, moved)

    def _takes_references(self) -> bool:
        """Return whether the law follows a reference; one that holds a rest objects to others."""
        objection = getattr(self.controller.law, "objection", None)
        if objection is None or objection(self._rest.plan):
            return True
        return not objection(self._course(np.ones(self._m)).plan)

    def ask(self, controller: Controller, tick: int, w: Vector) -> Vector:
        """Return the effort that a controller answers to a measurement near the rest."""
        m, a = self._m, self._appendages
        if self._follows and w[self._read.size :].any():
            controller.steer(self._course(w[self._read.size :]))
        y = self._read + w[: self._read.size]
        y[:m] = self._positions(w[:m])
        parts = np.split(y, np.cumsum([m, m, a, a]))
        answer = controller.observe(Measurement(tick, 0, self._time, controller.name, *parts))
        if answer is None:
            raise BadInput(f"{controller.name} gives no answer at rest: {controller.reason}")
        controller.steer(self._rest)
        return answer.command.effort

    def settle(self) -> None:
        """Let it rest until its memory changes no more.

        A covariance that takes longer is taken to where the filter's own ticks would, and they go
        on from there: to its limit, or to that of two days where a variance goes to nothing.
        """
        none, before, estimator = np.zeros(self.inputs), None, self.controller.estimator
        most = 2 * _SOON if isinstance(estimator, SettlesSlowly) else _MOST_TICKS
        while self.tick < most:
            for _ in range(100):
                self.ask(self.controller, self.tick, none)
                self.tick += 1
            if self.tick == _SOON and isinstance(estimator, SettlesSlowly):
                _settle(estimator)
            now = self._values(self.controller)
            if (
                before is not None
                and now.keys() == before.keys()
                and all(
                    np.shape(now[p]) == np.shape(before[p])
                    and np.abs(now[p] - before[p]).max()
                    <= _SETTLED * max(1e-3, np.abs(now[p]).max())
                    for p in now
                )
            ):
                break
            before = {place: np.copy(value) for place, value in now.items()}

    def _values(self, controller: Controller) -> dict[Place, Number]:
        return numbers(_parts(controller))

    def memory(self) -> list[Place]:
        """Return where it remembers what acts on a later effort."""
        rng, copies = np.random.default_rng(1), []
        for _ in range(2):
            one = copied(self.controller)
            for k in range(_EXCITED):
                self.ask(one, self.tick + k, 1e-4 * rng.standard_normal(self.inputs))
            copies.append(self._values(one))
        first, second = copies
        self.held = self._values(self.controller)
        moved = [
            place
            for place, value in self.held.items()
            if place in first and place in second
            and np.shape(first[place]) == np.shape(second[place]) == np.shape(value)
            and not np.array_equal(first[place], second[place])
        ]  # fmt: skip
        self._constant = {p: value for p, value in self.held.items() if p not in set(moved)}
        return self._acting(moved)

    def _acting(self, moved: list[Place]) -> list[Place]:
        """Return the places among these that act on an effort, now or through others."""
        rng, none = np.random.default_rng(2), np.zeros(self.inputs)
        still, base = self._after({}, none, moved)
        acts: dict[Place, set[Place]] = {}
        answers = set()
        for place in moved:
            value = self.held[place]
            h = _PROBE * max(np.abs(value).max(), 1e-3)
            bent = value + h * rng.standard_normal(np.shape(value))
            after, effort = self._after({place: bent}, none, moved)
            if np.abs(effort - base).max() > _NO_EFFECT * h:
                answers.add(place)
            acts[place] = {
                other
                for other in moved
                if np.abs(after[other] - still[other]).max()
                > max(_NO_EFFECT * h, 4e-16 * np.abs(still[other]).max())
            }
        found = set(answers)
        while more := {p for p in moved if p not in found and acts[p] & found}:
            found |= more
        return [place for place in moved if place in found]

    def _after(
        self, changes: dict[Place, Number], w: Vector, places: list[Place]
    ) -> tuple[dict[Place, Number], Vector]:
        """Return its memory and its effort after one tick from a changed memory."""
        one: Controller = copied(self.controller, self._constant)
        parts = _parts(one)
        for place, value in changes.items():
            assign(parts, place, value)
        effort = self.ask(one, self.tick, w)
        after = numbers(parts)
        return {place: after[place] for place in places}, effort

    def _flat(self, memory: list[Place], s: Vector | None, w: Vector) -> Vector:
        """Return [s(k + 1), u(k)] as one vector."""
        changes = {} if s is None else _placed(self.held, memory, s)
        after, effort = self._after(changes, w, memory)
        return np.concatenate([np.ravel(after[place]) for place in memory] + [effort])

    def slopes(self, memory: list[Place]) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """Return A, B, C and D by differences of fourth order."""
        start = np.concatenate([np.ravel(self.held[p]) for p in memory] + [np.zeros(0)])
        n, base = start.size, self._flat(memory, None, np.zeros(self.inputs))
        columns = []
        for j in range(n + self.inputs):
            one = np.zeros(n + self.inputs)
            one[j] = 1.0

            def at(s: float, one: Vector = one) -> Vector:
                return self._flat(memory, start + s * one[:n], s * one[n:])

            h = 1e-3
            moved = np.abs(at(_PROBE)[n:] - base[n:]) / _PROBE
            asked = float((moved / self._limit).max())
            h = min(h, _SHARE / asked) if asked > 0.0 else h
            columns.append((8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h))
        whole = np.array(columns).T.reshape(n + self._m, n + self.inputs)
        whole = np.where(abs(whole) < 1e-13, 0.0, whole)
        return whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]

    def mismatch(self, form: Lti, smaller: float = 1.0) -> tuple[float, float]:
        """Return how far form and code are from each other, of the largest effort [-].

        Efforts are those beside a copy that rests on: a memory of hours may still move there.

        Args:
            form: of the code.
            smaller: motions, of the usual ones.

        Returns:
            in small motions to one side, and at rest after them: an integral that the form lacks
            is small beside the efforts in motion, but stays.
        """
        rng, none = np.random.default_rng(3), np.zeros(self.inputs)
        one, resting = copied(self.controller), copied(self.controller)
        ticks = range(self.tick, self.tick + _CHECKED + _STILL)
        rested = [self.ask(resting, tick, none) for tick in ticks]  # first: they may share a memory
        size = np.abs(form.d).max() + np.abs(form.c @ form.b).max(initial=0.0)
        share = 0.1 * _SHARE * float(self._limit.max()) / max(size, 1e-300)
        s, largest, worst = np.zeros(len(form.a)), 1e-300, [0.0, 0.0]
        for k in range(_CHECKED + _STILL):
            moves = k < _CHECKED
            w = moves * smaller * min(share, 1e-4) * (1.0 + rng.standard_normal(self.inputs))
            ours = form.c @ s + form.d @ w
            s = form.a @ s + form.b @ w
            effort = self.ask(one, self.tick + k, w) - rested[k]
            worst[not moves] = max(worst[not moves], float(np.abs(effort - ours).max()))
            largest = max(largest, float(np.abs(ours).max()))
        moving, still = (off / largest if off > 0.0 else 0.0 for off in worst)
        return moving, still


@dataclass(frozen=True)
class _Held:
    """A course without an end: one reference at every tick."""

    plan: Plan
    held: Reference

    def reference(self, tick: int, hold: Reference) -> Reference:
        """Return it."""
        return self.held

    def restart(self) -> None:
        """Go on."""
