"""Estimators with equations of motion in a batch: the steps of the bench, member after member."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, TypeAlias, TypeVar, cast

import numpy as np

from flexslew_control.estimators.prediction import (
    Advance,
    Derivative,
    Jacobian,
    first_state,
    innovation_variance,
    kalman_prediction,
    measurement_update,
    steady_prediction,
)
from flexslew_control.estimators.small_motion_observer import MotionConstants, take_in
from flexslew_lab.studies.batch.laws.observers import BatchSignals, ObserverStep
from flexslew_plant.arrays import Matrix, Tensor, Vector, called, compiled, put
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.compiled.bound import bound
from flexslew_plant.testbeds.kernels import Kernels

_Numbers = TypeVar("_Numbers", bound=tuple[Vector, ...])


class MemberReadings(NamedTuple):
    """The inputs of a member's estimator at a tick."""

    first: bool  # whether it starts with them
    tick: int
    time: float  # [s]
    period: float  # [s]
    y: Vector  # readings
    effort: Vector  # that was held since the tick before


class MemberSizes(NamedTuple):
    """How many numbers a member has."""

    memory: int
    estimate: int  # written into z
    outputs: int  # that it reads
    joints: int
    variances: int  # of its innovation


# (numbers, a row for each member or for all; row; memory; readings; out: estimate, then variances)
MemberStep: TypeAlias = Callable[[_Numbers, int, Vector, MemberReadings, Vector], None]


class BatchFilter(NamedTuple):
    """The constants of linear_form.KalmanForm, with an axis for members in front."""

    packed: Matrix  # numbers of the equations
    q: Tensor
    c: Tensor
    r: Matrix
    first: Tensor


class BatchSteady(NamedTuple):
    """linear_form.SteadyForm likewise."""

    packed: Matrix
    gain: Tensor  # K, (members, 2 n, l)
    output: Tensor  # C, (members, l, 2 n)
    variance: Matrix  # of y - C x, (members, l)


@lru_cache
def by_member(step: MemberStep[_Numbers], sizes: MemberSizes) -> ObserverStep:
    """Return an observer that takes the step of an estimator for one member after another.

    Its memory holds that of each member, then rows of the innovations' variances.

    Args:
        step: of the estimator.
        sizes: of the estimator.
    """
    each, found, outputs, joints, variances = sizes

    @compiled
    def observer_step(
        k: int,
        t: float,
        dt: float,
        numbers: _Numbers,
        signals: BatchSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        y, effort, out = np.empty(outputs), np.empty(joints), np.empty(found + variances)
        variance = memory[each * BATCH_WIDTH :]
        for member in range(filled):
            row = member if len(numbers[0]) > 1 else 0
            own = memory[member * each : (member + 1) * each]
            for i in range(outputs):
                y[i] = signals.y[i * BATCH_WIDTH + member]
            for i in range(joints):
                effort[i] = signals.effort[i * BATCH_WIDTH + member]
            # after a reading that was no number it starts again, with one that is
            first = bool(k == 0 or (not np.isfinite(own).all() and np.isfinite(y).all()))
            step(numbers, row, own, MemberReadings(first, k, t, dt, y, effort), out)
            for i in range(found):
                z[i * BATCH_WIDTH + member] = out[i]
            for i in range(variances):
                variance[i * BATCH_WIDTH + member] = out[found + i]

    return cast(ObserverStep, observer_step)


class PredictionFunctions(NamedTuple):
    """The compiled functions of prediction: their first argument are the packed numbers."""

    jacobian: Jacobian
    advance: Advance
    derivative: Derivative


@lru_cache
def equations(kernels: Kernels, before: int, n: int) -> PredictionFunctions:
    """Return the functions of a model, at time zero where none is given.

    Args:
        kernels: its equations.
        before: coordinates before the modes.
        n: coordinates.
    """
    model = bound(kernels, n, before)
    slopes, integrate, rate, states = model.jacobian, model.advance, model.derivative, 2 * n

    @called
    def jacobian(packed: Vector, x: Vector, effort: Vector, t: float) -> tuple[Matrix, Matrix]:
        dx, du = np.empty((states, states)), np.empty((states, effort.size))
        slopes(packed, t, x, effort, dx, du)
        return dx, du

    @called
    def advance(packed: Vector, x: Vector, effort: Vector, dt: float, t: float) -> Vector:
        after = x.copy()
        integrate(packed, t, effort, dt, 1, before, after)
        return after

    @called
    def derivative(packed: Vector, x: Vector, effort: Vector) -> Vector:
        return rate(packed, 0.0, x, effort)

    return PredictionFunctions(jacobian, advance, derivative)


@lru_cache
def kalman(kernels: Kernels, before: int, n: int, sizes: MemberSizes) -> ObserverStep:
    """Return the KalmanFilter that predicts by equations; its memory is [x, P]."""
    it, outputs = equations(kernels, before, n), sizes.outputs
    states = sizes.estimate - outputs
    predict = called(kalman_prediction(n, it.jacobian, it.advance))

    @called
    def step(
        numbers: BatchFilter, row: int, memory: Vector, readings: MemberReadings, out: Vector
    ) -> None:
        first, _, t, dt, y, effort = readings
        packed, q, c, r = numbers.packed[row], numbers.q[row], numbers.c[row], numbers.r[row]
        x, p = memory[:states], memory[states:].reshape((states, states))
        if first:
            x, p, e = first_state(y, n, states), numbers.first[row], np.zeros(outputs)
            prior = p
        else:
            x, prior = predict(packed, q, x, p, effort, t - dt, dt)
            x, p, e, _ = measurement_update(x, prior, y, c, r)
        memory[:states], memory[states:] = x, p.ravel()
        out[:states], out[states : states + outputs] = x, e
        out[states + outputs :] = innovation_variance(prior, c, r)

    return by_member(step, sizes)


@lru_cache
def steady(kernels: Kernels, before: int, n: int, sizes: MemberSizes) -> ObserverStep:
    """Return the observer of linear_form.SteadyForm; its memory is [x, y]."""
    states, outputs = 2 * n, sizes.outputs
    predict = called(steady_prediction(equations(kernels, before, n).derivative))

    @called
    def step(
        numbers: BatchSteady, row: int, memory: Vector, readings: MemberReadings, out: Vector
    ) -> None:
        first, _, _, dt, y, effort = readings
        packed, gain, c = numbers.packed[row], numbers.gain[row], numbers.output[row]
        if first:
            x = first_state(y, n, states)
        else:
            inputs, feedback = gain @ memory[states:], gain @ c
            x = predict(packed, memory[:states], effort, inputs, feedback, dt)
        memory[:states], memory[states:] = x, y
        out[:states], out[states : states + outputs] = x, y - c @ x
        out[states + outputs :] = numbers.variance[row]

    return by_member(step, sizes)


@lru_cache
def small_motion(kernels: Kernels, before: int, sizes: MemberSizes) -> ObserverStep:
    """Return the SmallMotionObserver; its memory is [q, v]."""
    advance = equations(kernels, before, sizes.estimate // 2).advance

    @called
    def step(
        numbers: MotionConstants, row: int, memory: Vector, readings: MemberReadings, out: Vector
    ) -> None:
        first, _, t, dt, y, effort = readings
        if first:
            memory[:] = 0.0
            put(numbers.rest[row], memory[: numbers.rest.shape[1]])
        else:
            put(advance(numbers.packed[row], memory, effort, dt, t - dt), memory)
        take_in(kernels, numbers, row, y, memory, out, np.empty(y.size))

    return by_member(step, sizes)
