"""A controller that is evaluated at a rest: its memory, and its answers to small changes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.analysis.nonlinear_plant import sensor_outputs
from flexslew_control.analysis.numeric_state import Number, Place, assign, copied, numbers
from flexslew_control.analysis.rest import Rest
from flexslew_control.controllers.controller import Controller
from flexslew_control.law import Reference
from flexslew_control.plan import Plan
from flexslew_control.plans.course import PlanSequence
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

_CONVERGED = 1e-9  # change of a number in 100 ticks, of its size
_MOST_TICKS = 20_000  # until it must have settled
_SOON = 1_000  # ticks after which what settles slowly is taken ahead
_DOUBLINGS = 24  # of a tick: two days of them at 100 Hz
_TO_THE_END = 40  # doublings after which every covariance stands still that has a limit
_HAS_A_LIMIT = 0.01  # of what it is after two days: what is less by then goes to nothing
_PROBE_TICKS = 8  # ticks in which two copies measure different things
_PROBE = 1e-6  # of a number that is zero at rest
_SHARE = 1e-3  # of the effort limits that a perturbation may ask for
_ROUNDING = 1e-11  # of a perturbation: rounding
_CHECKED = 60  # ticks in which form and code are compared
_REST_TICKS = 20  # ticks at rest after them


@runtime_checkable
class SlowCovariance(Protocol):
    """An estimator with a covariance that may settle more slowly than ticks can be flown."""

    def settle(self, doublings: int) -> Matrix:
        """Let the covariance become that of 2^doublings ticks later at rest, and return it."""


class ProbeController:
    """A controller that answers the questions of a rest."""

    def __init__(
        self, controller: Controller, rest: Rest, limit: Vector, gains: Vector | None
    ) -> None:
        self._limit, self._m = limit, rest.model.joints
        self._time = rest.time
        self._read = np.concatenate((sensor_outputs(rest.model, rest.state, rest.effort, rest.time),
                                     rest.effort))  # fmt: skip
        self._appendages = len(rest.model.appendages.names)
        self._gains = np.zeros(0) if gains is None else gains
        self._effort = rest.effort
        self._attitude = rest.model.attitude
        self.controller: Controller = copied(controller)
        self._rest = self._constant_reference(np.zeros(self._m))
        self.controller.set_plan_sequence(self._rest)
        self._uses_reference = self._takes_references()
        self.tick = 0
        self.held: dict[Place, Number] = {}
        self._constant: dict[Place, Number] = {}

    @property
    def inputs(self) -> int:
        """How many numbers it measures, with the references."""
        return self._read.size + self._m

    def _constant_reference(self, changed: Vector) -> PlanSequence:
        """Return what rests for ever, its position moved."""
        m, template = self._m, self.controller
        rest, positions = np.zeros((2, m)), np.tile(self._positions(changed), (2, 1))
        gains = np.tile(self._gains, (2, 1)) if self._gains.size else np.zeros((0, 0))
        plan = Plan(
            "none", template.joint_names, 0.0, template.period, positions, rest, self._effort[None],
            np.zeros((2, 0)), 0.0, gains,
        )  # fmt: skip
        return cast(PlanSequence, _ConstantReference(plan, plan.reference(0)))

    def _positions(self, changed: Vector) -> Vector:
        """Return positions that are off the rest by this, shape (joints,).

        Of joints that read an attitude it is the rotation from the rest, as in linear_plant.
        """
        at = self._read[: self._m]
        if self._attitude is None or not self._attitude.rotation_vector_of(at).any():
            return at + changed
        return self._attitude.add_error(at, changed)

    def _takes_references(self) -> bool:
        """Return whether the law follows a reference; one that holds a rest objects to others."""
        check = getattr(self.controller.law, "objection", None)
        if check is None or check(self._rest.plan):
            return True
        return not check(self._constant_reference(np.ones(self._m)).plan)

    def ask(self, controller: Controller, tick: int, w: Vector) -> Vector:
        """Return the effort that a controller answers to a measurement near the rest."""
        m, a = self._m, self._appendages
        if self._uses_reference and w[self._read.size :].any():
            controller.set_plan_sequence(self._constant_reference(w[self._read.size :]))
        y = self._read + w[: self._read.size]
        y[:m] = self._positions(w[:m])
        parts = np.split(y, np.cumsum([m, m, a, a]))
        answer = controller.observe(Measurement(tick, 0, self._time, controller.name, *parts))
        if answer is None:
            raise BadInput(f"{controller.name} gives no answer at rest: {controller.reason}")
        controller.set_plan_sequence(self._rest)
        return answer.command.effort

    def settle(self) -> None:
        """Let it rest until its memory changes no more.

        A covariance that takes longer is taken to where the filter's own ticks would, and they go
        on from there: to its limit, or to that of two days where a variance goes to nothing.
        """
        none, before, estimator = np.zeros(self.inputs), None, self.controller.estimator
        most = 2 * _SOON if isinstance(estimator, SlowCovariance) else _MOST_TICKS
        while self.tick < most:
            for _ in range(100):
                self.ask(self.controller, self.tick, none)
                self.tick += 1
            if self.tick == _SOON and isinstance(estimator, SlowCovariance):
                _settle(estimator)
            now = self._values(self.controller)
            if (
                before is not None
                and now.keys() == before.keys()
                and all(
                    np.shape(now[p]) == np.shape(before[p])
                    and np.abs(now[p] - before[p]).max()
                    <= _CONVERGED * max(1e-3, np.abs(now[p]).max())
                    for p in now
                )
            ):
                break
            before = {place: np.copy(value) for place, value in now.items()}

    def _values(self, controller: Controller) -> dict[Place, Number]:
        return numbers(memory_parts(controller))

    def memory(self) -> list[Place]:
        """Return where it remembers what acts on a later effort."""
        rng, results = np.random.default_rng(1), []
        for _ in range(2):
            one = copied(self.controller)
            for k in range(_PROBE_TICKS):
                self.ask(one, self.tick + k, 1e-4 * rng.standard_normal(self.inputs))
            results.append(self._values(one))
        first, second = results
        self.held = self._values(self.controller)
        changed = [
            place
            for place, value in self.held.items()
            if place in first and place in second
            and np.shape(first[place]) == np.shape(second[place]) == np.shape(value)
            and not np.array_equal(first[place], second[place])
        ]  # fmt: skip
        self._constant = {p: value for p, value in self.held.items() if p not in set(changed)}
        return self._relevant_places(changed)

    def _relevant_places(self, changed: list[Place]) -> list[Place]:
        """Return the places among these that act on an effort, now or through others."""
        rng, none = np.random.default_rng(2), np.zeros(self.inputs)
        rest, base = self._after({}, none, changed)
        targets: dict[Place, set[Place]] = {}
        direct = set()
        for place in changed:
            value = self.held[place]
            h = _PROBE * max(np.abs(value).max(), 1e-3)
            modified = value + h * rng.standard_normal(np.shape(value))
            after, effort = self._after({place: modified}, none, changed)
            if np.abs(effort - base).max() > _ROUNDING * h:
                direct.add(place)
            targets[place] = {
                other
                for other in changed
                if np.abs(after[other] - rest[other]).max()
                > max(_ROUNDING * h, 4e-16 * np.abs(rest[other]).max())
            }
        found = set(direct)
        while more := {p for p in changed if p not in found and targets[p] & found}:
            found |= more
        return [place for place in changed if place in found]

    def _after(
        self, changes: dict[Place, Number], w: Vector, places: list[Place]
    ) -> tuple[dict[Place, Number], Vector]:
        """Return its memory and its effort after one tick from a changed memory."""
        one: Controller = copied(self.controller, self._constant)
        parts = memory_parts(one)
        for place, value in changes.items():
            assign(parts, place, value)
        effort = self.ask(one, self.tick, w)
        after = numbers(parts)
        return {place: after[place] for place in places}, effort

    def _flat(self, memory: list[Place], s: Vector | None, w: Vector) -> Vector:
        """Return [s(k + 1), u(k)] as one vector."""
        changes = {} if s is None else from_flat(self.held, memory, s)
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
            changed = np.abs(at(_PROBE)[n:] - base[n:]) / _PROBE
            sensitivity = float((changed / self._limit).max())
            h = min(h, _SHARE / sensitivity) if sensitivity > 0.0 else h
            columns.append((8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h))
        whole = np.array(columns).T.reshape(n + self._m, n + self.inputs)
        whole = np.where(abs(whole) < 1e-13, 0.0, whole)
        return whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]

    def mismatch(self, form: Lti, scale: float = 1.0) -> tuple[float, float]:
        """Return how far form and code are from each other, of the largest effort [-].

        Efforts are differences from a copy that rests on: a memory of hours may still move there.

        Args:
            form: linear form of the code.
            scale: motions, of the usual ones.

        Returns:
            in small motions to one side, and at rest after them: an integral that the form lacks
            is small compared with the efforts in motion, but stays.
        """
        rng, none = np.random.default_rng(3), np.zeros(self.inputs)
        one, static = copied(self.controller), copied(self.controller)
        ticks = range(self.tick, self.tick + _CHECKED + _REST_TICKS)
        rest_efforts = [
            self.ask(static, tick, none) for tick in ticks
        ]  # first: they may share a memory
        size = np.abs(form.d).max() + np.abs(form.c @ form.b).max(initial=0.0)
        share = 0.1 * _SHARE * float(self._limit.max()) / max(size, 1e-300)
        s, largest, errors = np.zeros(len(form.a)), 1e-300, [0.0, 0.0]
        for k in range(_CHECKED + _REST_TICKS):
            active = k < _CHECKED
            w = active * scale * min(share, 1e-4) * (1.0 + rng.standard_normal(self.inputs))
            predicted = form.c @ s + form.d @ w
            s = form.a @ s + form.b @ w
            effort = self.ask(one, self.tick + k, w) - rest_efforts[k]
            errors[not active] = max(errors[not active], float(np.abs(effort - predicted).max()))
            largest = max(largest, float(np.abs(predicted).max()))
        motion, rest = (off / largest if off > 0.0 else 0.0 for off in errors)
        return motion, rest


@dataclass(frozen=True)
class _ConstantReference:
    """A course without an end: one reference at every tick."""

    plan: Plan
    held: Reference

    def reference(self, tick: int, default: Reference) -> Reference:
        """Return it."""
        return self.held

    def restart(self) -> None:
        """Go on."""


def memory_parts(controller: Controller) -> dict[str, Any]:
    """Return what a controller remembers in."""
    return {"estimator": controller.estimator, "law": controller.law}


def from_flat(
    template: dict[Place, Number], memory: Sequence[Place], flat: Vector
) -> dict[Place, Number]:
    """Return the numbers of a flat vector by place, in the shapes of those that are held."""
    out: dict[Place, Number] = {}
    at = 0
    for place in memory:
        value = template[place]
        part = flat[at : at + np.size(value)]
        at += part.size
        out[place] = float(part[0]) if np.isscalar(value) else part.reshape(np.shape(value))
    return out


def _settle(estimator: SlowCovariance) -> None:
    """Take a covariance to its limit; where it has none that is not zero, to that of two days."""
    later: SlowCovariance = copied(estimator)
    limit = np.diag(later.settle(_TO_THE_END))
    days = np.diag(estimator.settle(_DOUBLINGS))
    if (limit >= _HAS_A_LIMIT * days).all():
        estimator.settle(_TO_THE_END)
