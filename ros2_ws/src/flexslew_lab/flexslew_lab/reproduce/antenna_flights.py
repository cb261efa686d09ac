"""Flights of the linear examples of Kwak (1989), by the implicit midpoint rule on M, D, K, B, d."""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.lqr import disturbance_gain, regulator
from flexslew_control.controllers.retargeting.disturbance_accommodating import (
    IntegralWeights,
    integral_gains,
)
from flexslew_control.controllers.retargeting.modal_space import modal_gains
from flexslew_control.linear.perturbation import ModalGains, Regulator, backward
from flexslew_control.linear.perturbation import regulator as zero_order
from flexslew_control.linear.small_motion import (
    Frozen,
    SmallMotion,
    last_rotation_end,
    small_motion,
)
from flexslew_lab.reproduce import planar_antenna
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed
from flexslew_plant.testbeds.spacecraft.units import UNITS

RUN, SLEW_TIME = 6.0, 3.0  # of examples 1, 2 and 5: the whole, and the turns in it [s]
STEP = 0.004  # [s]
FINE = 0.001  # of the short examples 3 and 4 [s]


class AntennaFeedback(NamedTuple):
    """u = -[Kp, Kd, Ki] (x, x', integral of x) + f over one step."""

    gains: Matrix  # (m, 3 k)
    effort: Vector  # f, (m,)


def simulate(
    middle: Sequence[Frozen], step: float, control: Sequence[AntennaFeedback] | None
) -> Matrix:
    """Return the coordinates at the edges of all steps, from rest, shape (steps + 1, k).

    Args:
        middle: the equations in the middle of every step.
        step: [s].
        control: over every step; None: none.
    """
    k = len(middle[0].mass)
    y, one = np.zeros(3 * k), np.eye(3 * k)
    found, last, solved, input_vector = [y[:k]], None, one, y
    for index, frozen in enumerate(middle):
        now = frozen, None if control is None else control[index]
        if last is None or now[0] is not last[0] or now[1] is not last[1]:
            system_matrix, input_vector = _rates(*now)
            half = 0.5 * step * system_matrix
            inverse = np.linalg.inv(one - half)
            solved, input_vector, last = (
                inverse @ (one + half),
                step * (inverse @ input_vector),
                now,
            )
        y = solved @ y + input_vector
        found.append(y[:k])
    return np.array(found)


def _rates(frozen: Frozen, control: AntennaFeedback | None) -> tuple[Matrix, Vector]:
    """Return F and b of y' = F y + b for y = (x, x', integral of x)."""
    k = len(frozen.mass)
    f, force = np.zeros((3 * k, 3 * k)), frozen.disturbance
    f[: 2 * k, : 2 * k] = frozen.state_matrix
    f[2 * k :, :k] = np.eye(k)
    if control is not None:
        force = force + frozen.input_matrix @ control.effort
        feedback = np.linalg.solve(frozen.mass, frozen.input_matrix @ control.gains)
        f[k : 2 * k] -= feedback
    input_vector = np.zeros(3 * k)
    input_vector[k : 2 * k] = np.linalg.solve(frozen.mass, force)
    return f, input_vector


class Example(NamedTuple):
    """An example's small motions over a run."""

    motion: SmallMotion
    middle: list[Frozen]  # of every step

    def in_si_units(self, path: Matrix) -> Matrix:
        """Return coordinates in SI from those in the example's units."""
        kept: Vector = self.motion.units.coordinates[self.motion.kept]
        return np.asarray(path * kept)

    def modes(self, path: Matrix) -> Matrix:
        """Return the modal coordinates in SI, shape (steps + 1, modes)."""
        model = self.motion.model
        whole = np.zeros((len(path), model.coordinates))
        whole[:, self.motion.kept] = self.in_si_units(path)
        return whole[:, model.before_modes :]

    def tips(self, path: Matrix) -> Matrix:
        """Return displacements of the tips in the example's lengths, shape (steps + 1, tips)."""
        length = float(self.motion.units.coordinates[0])
        return np.asarray(self.modes(path) @ self.motion.model.appendages.tip.T / length)


@lru_cache
def example(name: str, changes: tuple[tuple[str, Any], ...] = ()) -> Example:
    """Return a shipped example's small motions.

    Args:
        name: of the trial.
        changes: keys of the shape of its appendage, with other values.
    """
    values: dict[str, Any] = {}
    if changes:
        testbed = example_trial(name).testbed
        assert isinstance(testbed, SpacecraftTestbed)
        values = _shape_changes(next(iter(testbed.appendages)), changes)
    testbed = example_trial(name, values).testbed
    motion = small_motion(testbed, last_rotation_end(testbed))
    slew_steps = [motion.at(t) for t in STEP * (np.arange(round(SLEW_TIME / STEP)) + 0.5)]
    return Example(
        motion, slew_steps + [motion.at(SLEW_TIME + STEP)] * round((RUN - SLEW_TIME) / STEP)
    )


def flexible_shape(name: str) -> FlexibleShape:
    """Return the shape of a shipped example's first appendage."""
    testbed = example_trial(name).testbed
    assert isinstance(testbed, SpacecraftTestbed)
    shape = testbed.craft.appendages[0].shape
    assert shape is not None
    return shape


def _shape_changes(appendage: str, changes: tuple[tuple[str, Any], ...]) -> dict[str, Any]:
    """Return changes of an appendage's shape as changes of a trial."""
    return {"testbed": {"appendages": {appendage: {"shape": dict(changes)}}}}


@lru_cache
def open_path(name: str, changes: tuple[tuple[str, Any], ...] = ()) -> Matrix:
    """Return the path of an example without control, in its units."""
    return simulate(example(name, changes).middle, STEP, None)


@lru_cache
def reference_tips(modes: int) -> Matrix:
    """Return the tip of example 1 with m_e, S_e and I_e as printed, open, in the turn [ft].

    No beam has these numbers (S^2 / m > I): a model takes them all the same.

    Args:
        modes: admissible functions in each direction.
    """
    changes = (("linear_density", 0.06), ("modes_across", modes), ("modes_third", modes))
    case = example("antenna_1", changes)
    unit, motion = UNITS["slug_ft_lb"], case.motion
    testbed = example_trial("antenna_1", _shape_changes("beam", changes)).testbed
    assert isinstance(testbed, SpacecraftTestbed)
    spacecraft = testbed.craft
    a = spacecraft.appendages[0]
    first, second = np.zeros(3), np.zeros((3, 3))
    first[2], second[2, 2] = 1.65 * unit.mass * unit.length, 1.25 * unit.torque
    a = replace(a, integrals=replace(a.integrals, first=first, second=second))
    model = replace(motion.model, packed=packed(replace(spacecraft, appendages=(a,))))
    case = case._replace(motion=replace(motion, model=model))
    steps = round(SLEW_TIME / STEP)
    middle = [case.motion.at(t) for t in STEP * (np.arange(steps) + 0.5)]
    return case.tips(simulate(middle, STEP, None))


@lru_cache
def minimum_disturbance_path() -> Matrix:
    """Return the path of example 1 under disturbance minimisation and a regulator."""
    case = example("antenna_1")
    before = case.motion.before()
    a, b = before.state_matrix, before.state_input_matrix
    gain, _ = regulator(a, b, 100.0 * np.eye(len(a)), 0.001 * np.eye(b.shape[1]))
    gains = np.hstack((gain, np.zeros((len(gain), len(a) // 2))))
    known: dict[int, AntennaFeedback] = {}
    for frozen in case.middle:
        if id(frozen) not in known:
            s, d = frozen.input_matrix, frozen.disturbance
            known[id(frozen)] = AntennaFeedback(gains, -(disturbance_gain(s) @ d))
    return simulate(case.middle, STEP, [known[id(frozen)] for frozen in case.middle])


@lru_cache
def integral_path() -> Matrix:
    """Return the path of example 2 under PI control."""
    case = example("antenna_2")
    before = case.motion.before()
    gains = integral_gains(before, IntegralWeights())
    control = AntennaFeedback(gains, np.zeros(len(gains)))
    return simulate(case.middle, STEP, [control] * len(case.middle))


class TimeVarying(NamedTuple):
    """An example with gains that change: 3, the oscillator, or 4, the planar antenna."""

    regulator: Regulator
    middle: list[Frozen]  # of every step
    after: Frozen


@lru_cache
def time_varying(number: int) -> TimeVarying:
    """Return example 3 or 4."""
    times = FINE * (np.arange(round(SLEW_TIME / FINE)) + 0.5)
    if number == 4:
        before = planar_antenna.before()
        middle, after = [planar_antenna.planar(t) for t in times], planar_antenna.planar(SLEW_TIME)
        after = replace(  # at rest at its end
            after,
            damping=0.0 * after.damping,
            stiffness=before.stiffness,
            disturbance=before.disturbance,
        )
    else:
        motion = small_motion(example_trial("antenna_3").testbed, SLEW_TIME)
        before, middle, after = motion.before(), [motion.at(t) for t in times], motion.before()
    k = len(before.mass)
    return TimeVarying(zero_order(before, np.eye(3 * k), 0.01 * np.eye(k)), middle, after)


@lru_cache
def first_order(number: int, end: str) -> list[Matrix]:
    """Return P1 at the edges of the steps: backward from `zero` or `adiabatic`, or `frozen`."""
    case = time_varying(number)
    changes = [case.regulator.change(frozen) for frozen in (*case.middle, case.after)]
    if end == "frozen":
        return [case.regulator.adiabatic(change) for change in changes]
    return backward(case.regulator, changes, FINE, end)  # type: ignore[arg-type]


def modal_gains_of(number: int, end: str) -> list[ModalGains]:
    """Return the gains over every step."""
    case = time_varying(number)
    edges = first_order(number, end)
    return [
        case.regulator.gains(case.regulator.change(frozen), 0.5 * (a + b))
        for frozen, a, b in zip(case.middle, edges, edges[1:], strict=False)
    ]


@lru_cache
def time_varying_path(number: int, law: str) -> Matrix:
    """Return the path of example 3 or 4 under `none`, `zero`, `adiabatic`, `frozen` or `imsc`."""
    case = time_varying(number)
    if law == "none":
        return simulate(case.middle, FINE, None)
    if law == "imsc":
        gain = modal_gains(case.regulator.squares, 0.01)
        control = AntennaFeedback(np.array([[gain[0][0], gain[1][0], 0.0]]), np.zeros(1))
        return simulate(case.middle, FINE, [control] * len(case.middle))
    u = np.linalg.inv(case.regulator.modes)
    control_steps = [
        AntennaFeedback(
            u.T @ np.hstack([part @ u for part in (g.proportional, g.rate, g.integral)]), 0 * u[0]
        )
        for g in modal_gains_of(number, law)
    ]
    return simulate(case.middle, FINE, control_steps)


def exact_riccati(number: int) -> list[Matrix]:
    """Return P of the full Riccati equation (3-34) at the edges, backward from the end."""
    case = time_varying(number)
    r = case.regulator
    b, k = r.input_matrix, len(r.squares)
    s = b @ r.inverse_weight @ b.T
    rest_matrix = r.state_matrix + r.perturbation(r.change(case.after))
    _, p = regulator(rest_matrix, b, r.state_weight, r.effort_weight)
    found = [p]
    for frozen in reversed(case.middle):
        a = r.state_matrix + r.perturbation(r.change(frozen))

        def slope(p: Matrix, a: Matrix = a) -> Matrix:
            return np.asarray(p @ a + a.T @ p + r.state_weight - p @ s @ p)

        first = slope(p)
        second = slope(p + 0.5 * FINE * first)
        third = slope(p + 0.5 * FINE * second)
        p = p + FINE / 6.0 * (first + 2.0 * (second + third) + slope(p + FINE * third))
        found.append(p)
    assert len(p) == 3 * k
    return found[::-1]


def riccati_error(number: int, end: str) -> float:
    """Return the root mean square over the run of the norm of P0 + P1 - P."""
    p0 = time_varying(number).regulator.riccati
    pairs = zip(first_order(number, end), exact_riccati_of(number), strict=True)
    return float(np.sqrt(np.mean([((p0 + p1 - p) ** 2).sum() for p1, p in pairs])))


@lru_cache
def exact_riccati_of(number: int) -> list[Matrix]:
    """Return exact_riccati, once."""
    return exact_riccati(number)
