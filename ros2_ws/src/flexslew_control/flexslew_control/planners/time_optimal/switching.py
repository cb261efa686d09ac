"""Bang-bang slews of one joint by their switch times (papers/001, sections 2 and 3).

The unknowns are the durations d of the arcs between the switches. The end conditions are rest at
the goal and, for a robust slew, no sensitivity to the stiffness k:
    r(d) = x(t_f) - x_goal = 0,    dx/dk(t_f) = 0    (5), (13), (30),
where x are the modes or the whole state. The sensitivity is that of a bench which follows the
slew under its feedback; without gains, of the open loop, as in the paper.
Newton's method solves them from the closed form of the linear model. Where that start is too far
away, goal and effort are both scaled up from nearly zero, where the closed form is exact.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import minimize_scalar

from flexslew_control.planners.time_optimal.arcs import final_sensitivity, final_states
from flexslew_control.planners.time_optimal.linear_switching import five_switches, three_switches
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model

Insensitive: TypeAlias = Literal["modes", "state"]

# fourth-order difference by the stiffness factor: exact to about 1e-11 of the derivative
_CHANGE = 1e-3
STENCIL = tuple(
    (1.0 + j * _CHANGE, w / (12.0 * _CHANGE))
    for j, w in ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0))
)
_STEP = 0.25  # longest integration step, as an angle of the fastest mode [rad]


@dataclass(frozen=True)
class BangBang:
    """A slew of one joint with its effort at +- amplitude.

    Args:
        model: what is turned.
        joint: which joint.
        start: state at rest, shape (2 n,).
        distance: how far the joint goes [rad or m].
        amplitude: of the effort [N m or N].
        robust: whether the end must not be sensitive to the stiffness.
        kp, kd: gains of the joint's feedback that flies the slew; none: open loop.
        insensitive: what must not be: the modes (5 switches for one) or the whole state.
    """

    model: Model
    joint: int
    start: Vector
    distance: float
    amplitude: float
    robust: bool
    kp: float = 0.0
    kd: float = 0.0
    insensitive: Insensitive = "modes"

    @property
    def open_loop(self) -> bool:
        """Whether nothing feeds back."""
        return self.kp == 0.0 and self.kd == 0.0

    @property
    def step(self) -> float:
        """Longest integration step [s]."""
        linear = self.model.linearise(self.start[: self.model.coordinates])
        return float(_STEP / linear.frequencies[-1])

    @property
    def inertia(self) -> float:
        """Of the whole, appendages straight [kg m^2 or kg]."""
        q = self.start[: self.model.coordinates]
        return float(self.model.mass_matrix(q)[self.joint, self.joint])

    @property
    def rigid_duration(self) -> float:
        """Duration of the rigid body's time-optimal slew [s]."""
        return float(2.0 * np.sqrt(abs(self.distance) * self.inertia / self.amplitude))

    @property
    def rows(self) -> Vector:
        """Which entries of the state the end conditions hold: the joint, the modes, their rates."""
        n, m = self.model.coordinates, self.model.joints
        half = np.array([self.joint, *range(m, n)])
        return np.concatenate((half, n + half))

    @property
    def insensitive_rows(self) -> Vector:
        """Which entries of the state may not be sensitive to the stiffness."""
        n, m = self.model.coordinates, self.model.joints
        modal = np.arange(m, n)
        return np.concatenate((modal, n + modal)) if self.insensitive == "modes" else self.rows

    @property
    def conditions(self) -> Matrix:
        """C of the end conditions r = C z - goal, z the final states of all copies."""
        size = self.start.size
        nominal: Matrix = np.eye(size)[self.rows]
        if not self.robust:
            return nominal
        derivative: Matrix = np.eye(size)[self.insensitive_rows]
        whole = np.zeros((len(nominal) + len(derivative), size * (1 + len(STENCIL))))
        whole[: len(nominal), :size] = nominal
        for k, (_, weight) in enumerate(STENCIL, start=1):
            whole[len(nominal) :, k * size : (k + 1) * size] = weight * derivative
        return whole

    @property
    def ensemble(self) -> tuple[Kernels, Matrix, Vector, Vector]:
        """What the kernels of `arcs` simulate: equations, parameters of the copies, the gains."""
        return self.copies((1.0, *(factor for factor, _ in STENCIL)) if self.robust else (1.0,))

    def copies(self, factors: tuple[float, ...]) -> tuple[Kernels, Matrix, Vector, Vector]:
        """Return an ensemble with the stiffness times these factors, the nominal one first."""
        packed = np.array([self.model.with_stiffness(factor).packed for factor in factors])
        kp, kd = np.zeros(self.model.joints), np.zeros(self.model.joints)
        kp[self.joint], kd[self.joint] = self.kp, self.kd
        return self.model.kernels, packed, kp, kd

    def efforts(self, arcs: int, scale: float = 1.0) -> Matrix:
        """Return the effort of each arc, shape (arcs, joints)."""
        out = np.zeros((arcs, self.model.joints))
        signs = np.where(np.arange(arcs) % 2 == 0, 1.0, -1.0)
        out[:, self.joint] = scale * self.amplitude * np.sign(self.distance) * signs
        return out

    def final(self, durations: Vector, factor: float = 1.0, feedback: bool = False) -> Vector:
        """Return the state at the end with the stiffness times factor, shape (2 n,).

        Args:
            durations: of the arcs [s].
            factor: of the stiffness [-].
            feedback: whether the gains hold it to the nominal slew.
        """
        factors = (1.0, factor) if feedback else (factor,)
        efforts = self.efforts(durations.size)
        return np.asarray(
            final_states(*self.copies(factors), self.start, efforts, durations, self.step)[-1]
        )

    def residual(self, durations: Vector, scale: float = 1.0) -> Vector:
        """Return what misses the end conditions, divided by scale."""
        efforts = self.efforts(durations.size, scale)
        z = final_states(*self.ensemble, self.start, efforts, durations, self.step)
        return self._missed(z.ravel(), scale)

    def linearised(self, durations: Vector, scale: float = 1.0) -> tuple[Vector, Matrix]:
        """Return the residual and its derivatives by the durations, dr/dd."""
        efforts = self.efforts(durations.size, scale)
        z, slopes = final_sensitivity(*self.ensemble, self.start, efforts, durations, self.step)
        return self._missed(z, scale), np.asarray(self.conditions @ slopes / scale)

    def _missed(self, z: Vector, scale: float) -> Vector:
        goal = self.start.copy()
        goal[self.joint] += scale * self.distance
        r = self.conditions @ z
        r[: self.rows.size] -= goal[self.rows]
        return np.asarray(r / scale)


def linear_durations(slew: BangBang) -> Vector:
    """Return the arcs of the linear undamped one-mode slew, shape (4,) or, robust, (6,).

    Switches at T, T +- t1 (and T +- t2), with T the half of t_f, w the frequency and J inertia:
        three:  T^2/2 - t1^2 = J x/(2 u),  2 cos(w t1) = 1 + cos(w T);
        five:   T^2/2 - t2^2 + t1^2 = J x/(2 u),  1 - 2 cos(w t1) + 2 cos(w t2) = cos(w T), and
                the derivative of the latter by w; the smallest T is taken.

    Raises:
        PlanFailed: no such arcs within the range searched.
    """
    w = float(slew.model.linearise(slew.start[: slew.model.coordinates]).frequencies[0])
    a = slew.inertia * abs(slew.distance) / slew.amplitude * w**2  # in phase angles
    if slew.robust:
        t, t1, t2 = five_switches(a)
        half = [t - t2, t2 - t1, t1]
    else:
        t, t1 = three_switches(a)
        half = [t - t1, t1]
    return np.array(half + half[::-1]) / w


def solve_durations(slew: BangBang, guess: Vector, scale: float = 1.0) -> Vector | None:
    """Return the durations that meet the end conditions, by Newton's method; None if it fails."""
    d = guess.copy()
    for _ in range(25):
        r, j = slew.linearised(d, scale)
        if not (np.isfinite(r).all() and np.isfinite(j).all()) or np.linalg.cond(j) > 1e13:
            return None
        change = -np.linalg.solve(j, r)
        shrinking = change < 0.0
        room = float(np.min(-d[shrinking] / change[shrinking])) if shrinking.any() else np.inf
        d = d + min(1.0, 0.8 * room) * change
        if room > 1.0 and np.abs(change).max() < 1e-9:
            return d
    return None


def continued_durations(slew: BangBang) -> Vector | None:
    """Return the durations of the arcs, from the linear closed form; None if there are none."""
    guess = linear_durations(slew)
    direct = solve_durations(slew, guess)
    if direct is not None:
        return direct
    scale, ahead = 0.0, 0.125
    while scale < 1.0:
        found = solve_durations(slew, guess, min(1.0, scale + ahead))
        if found is None:
            ahead /= 2.0
            if ahead < 1.0 / 64.0:
                return None
        else:
            scale, guess = min(1.0, scale + ahead), found
    return guess


def five_switch_durations(slew: BangBang) -> Vector | None:
    """Return the shortest arcs with five switches that end at rest, shape (6,); None if none.

    For undamped models: the effort is antisymmetric about the middle, where the joint must be
    half way and the mode zero. For a first switch at p these two equations give the width of
    the first pulse and T(p) by Newton's method; the smallest T(p) is taken.
    """
    half = slew.rigid_duration / 2.0
    rows = np.array([slew.joint, slew.model.joints])
    middle = slew.start[rows] + np.array([0.5 * slew.distance, 0.0])
    ensemble, efforts = slew.copies((1.0,)), slew.efforts(3)

    def arcs(p: float) -> Vector | None:
        d = np.array([p, 0.0, half - p])
        for _ in range(20):
            x, by_duration = final_sensitivity(*ensemble, slew.start, efforts, d, slew.step)
            change = np.linalg.solve(by_duration[rows, 1:], middle - x[rows])
            if not np.isfinite(change).all() or np.abs(change).max() > half:
                return None
            d = d + np.append(0.0, change)
            if np.abs(change).max() < 1e-12 * half:
                return d if d.min() > 0.0 else None
        return None

    def length(p: float) -> float:
        d = arcs(p)
        return float("inf") if d is None else float(d.sum())

    grid: Vector = half * np.linspace(0.01, 0.99, 99)
    lengths = [length(float(p)) for p in grid]
    best = int(np.argmin(lengths))
    if not np.isfinite(lengths[best]):
        return None
    bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, 98)]))
    found = minimize_scalar(length, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    d = arcs(float(found.x)) if found.fun <= lengths[best] else arcs(float(grid[best]))
    if d is None:
        return None
    whole = np.concatenate((d, d[::-1]))
    return whole if np.abs(slew.residual(whole)).max() < 1e-7 else None
