"""How estimators start and predict: one source for the bench, and for compiled code of batches.

A prediction is made of a model's functions: those of a Model on the bench, which then calls it as
it stands, or compiled ones, for a compiled prediction. Their first argument are the numbers of the
equations, for those that have them from elsewhere.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from flexslew_control.linear.held_step import exponential_step
from flexslew_plant.arrays import Matrix, Vector, compiled_once

# (numbers, x, effort, t): df/dx and df/du
Jacobian: TypeAlias = Callable[[Vector, Vector, Vector, float], tuple[Matrix, Matrix]]
# (numbers, x, effort, dt, t): x dt after t, the effort held
Advance: TypeAlias = Callable[[Vector, Vector, Vector, float, float], Vector]
# (numbers, x, effort): f(x, u)
Derivative: TypeAlias = Callable[[Vector, Vector, Vector], Vector]
# (numbers, Q, x, P, effort, t, dt): x and P dt after t
KalmanPrediction: TypeAlias = Callable[
    [Vector, Matrix, Vector, Matrix, Vector, float, float], tuple[Vector, Matrix]
]
# (numbers, x, effort, K y, K C, dt): x a tick later
SteadyPrediction: TypeAlias = Callable[[Vector, Vector, Vector, Vector, Matrix, float], Vector]

_SLOW = 1.0 / 16.0  # what modes turn in a tick at most, for a series of second order [rad]


@compiled_once()
def first_state(y: Vector, n: int, states: int) -> Vector:
    """Return the state [q, v, ...] of the first reading: joints as measured, all else zero.

    Args:
        y: positions of the joints, their rates, and perhaps a tip.
        n: coordinates q.
        states: size of the state.
    """
    x, m = np.zeros(states), y.size // 2
    for i in range(m):
        x[i], x[n + i] = y[i], y[m + i]
    return x


def first_gain(outputs: int, n: int, states: int) -> Matrix:
    """Return S of first_state = S y, shape (states, outputs)."""
    return np.array([first_state(y, n, states) for y in np.eye(outputs)]).T


@compiled_once()
def error_transition(dx: Matrix, du: Matrix, dt: float) -> Matrix:
    """Return F = exp(J dt) with J = [[df/dx, df/du], [0, 0]].

    Where modes turn by less than _SLOW in a tick it is I + J dt + (J dt)^2 / 2: their variances are
    then right within one per cent, however little noise a filter believes them to have.

    Args:
        dx: df/dx, shape (2 n, 2 n).
        du: df/dd, the efforts' columns, as disturbances add to the efforts, shape (2 n, d).
        dt: one tick [s].
    """
    k, d = du.shape
    j = np.zeros((k + d, k + d))
    square = 0.0  # of what modes turn in a tick, at least; the same in all units
    for row in range(k):
        for column in range(k):
            j[row, column] = dx[row, column] * dt
            square += 0.5 * abs(dx[row, column] * dx[column, row]) * dt**2
        for column in range(d):
            j[row, k + column] = du[row, column] * dt
    if square < _SLOW**2:
        return np.eye(k + d) + j + 0.5 * (j @ j)
    step, f = j[:k].copy(), np.eye(k + d)
    exponential_step(step)
    for row in range(k):
        for column in range(k + d):
            f[row, column] = step[row, column]
    return f


@compiled_once()
def predicted_covariance(
    dx: Matrix, du: Matrix, covariance: Matrix, noise: Matrix, dt: float
) -> Matrix:
    """Return F P F^T + Q, see error_transition.

    Args:
        dx: as there.
        du: as there.
        covariance: P, shape (2 n + d, 2 n + d).
        noise: Q of one tick, same shape.
        dt: one tick [s].
    """
    f = error_transition(dx, du, dt)
    return f @ covariance @ f.T + noise


@compiled_once()
def measurement_update(
    x: Vector, covariance: Matrix, y: Vector, c: Matrix, r: Vector
) -> tuple[Vector, Matrix, Vector, float]:
    """Return x and P after the measurement, the innovation y - C x, and its NIS.

    One scalar output after the other, which is exact as the sensors' noises are independent;
    the squares of the scalar innovations over their variances add up to e^T S^-1 e.

    Args:
        x: predicted state, shape (k,).
        covariance: P, shape (k, k).
        y: outputs, shape (l,).
        c: shape (l, k).
        r: variances of the sensors, shape (l,).
    """
    x, p = x.copy(), covariance.copy()
    k = x.size
    innovation, gain = y.copy(), np.empty(k)
    for i in range(y.size):  # loops: BLAS takes three times as long for so few numbers
        for a in range(k):
            innovation[i] -= c[i, a] * x[a]
    nis = 0.0
    for i in range(y.size):
        s, e = 0.0, 0.0
        for a in range(k):
            gain[a] = 0.0
            for b in range(k):
                gain[a] += p[a, b] * c[i, b]
        for a in range(k):
            s += c[i, a] * gain[a]
            e += c[i, a] * x[a]
        s, e = r[i] + s, y[i] - e
        nis += e * e / s
        for a in range(k):
            x[a] += gain[a] * e / s
            for b in range(k):
                p[a, b] -= gain[a] * gain[b] / s
    return x, 0.5 * (p + p.T), innovation, nis


def gain_of(covariance: Matrix, c: Matrix, r: Vector) -> tuple[Matrix, Matrix]:
    """Return what a measurement is multiplied by, shape (k, l), and P after it; see corrected."""
    zero = np.zeros(len(covariance))
    columns = [measurement_update(zero, covariance, e, c, r) for e in np.eye(len(c))]
    return np.array([x for x, *_ in columns]).T, columns[0][1]


@compiled_once()
def innovation_variance(covariance: Matrix, c: Matrix, r: Vector) -> Vector:
    """Return the diagonal of C P C^T + R of a predicted covariance P, shape (l,)."""
    variance = r.copy()
    for i in range(r.size):
        for a in range(c.shape[1]):
            for b in range(c.shape[1]):
                variance[i] += c[i, a] * covariance[a, b] * c[i, b]
    return variance


def kalman_prediction(n: int, jacobian: Jacobian, advance: Advance) -> KalmanPrediction:
    """Return the prediction of a filter of [q, v, d], d a random walk on each effort, or none.

    x+ = the model a tick later under effort + d, P+ = F P F^T + Q; see error_transition.

    Args:
        n: coordinates q.
        jacobian: of the model.
        advance: of the model.
    """
    k = 2 * n

    def predict(
        numbers: Vector, noise: Matrix, x: Vector, p: Matrix, effort: Vector, t: float, dt: float
    ) -> tuple[Vector, Matrix]:
        state, d = x[:k], x[k:]
        total = effort + d if d.size else effort
        dx, du = jacobian(numbers, state, total, t)
        prior = predicted_covariance(dx, du[:, : d.size], p, noise, dt)
        return np.concatenate((advance(numbers, state, total, dt, t), d)), prior

    return predict


def steady_prediction(derivative: Derivative) -> SteadyPrediction:
    """Return a step of RK4 a tick for x' = f(x, u) + K (y - C x), y and u held.

    Args:
        derivative: f.
    """

    def predict(
        numbers: Vector, x: Vector, effort: Vector, inputs: Vector, feedback: Matrix, h: float
    ) -> Vector:
        k1 = derivative(numbers, x, effort) + (inputs - feedback @ x)
        at = x + 0.5 * h * k1
        k2 = derivative(numbers, at, effort) + (inputs - feedback @ at)
        at = x + 0.5 * h * k2
        k3 = derivative(numbers, at, effort) + (inputs - feedback @ at)
        at = x + h * k3
        k4 = derivative(numbers, at, effort) + (inputs - feedback @ at)
        return x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)

    return predict
