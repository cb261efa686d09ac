"""Whether a law that is called once per tick stays stable, on all modes of the bench."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from flexslew_control.controllers.sliding.design_model import observer_step
from flexslew_control.controllers.sliding.one_appendage import OneAppendage
from flexslew_control.controllers.sliding.sliding_surface import SlidingDesign
from flexslew_control.linear.free_platform import rate_outputs
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.model import Model

_CLOSE = 1e-6  # above one: rounding of a motion that nothing holds
_MIN_PERIOD = 1e-3  # of the period: shorter ones are not looked at


class SampledPlant(Protocol):
    """The small motions of a plant about a rest, and what a collocated law sees of them."""

    @property
    def position(self) -> Matrix:
        """From the state to what the law takes for its joints' positions."""

    @property
    def velocity(self) -> Matrix:
        """From the state to their rates."""

    def step(self, period: float) -> tuple[Matrix, Matrix]:
        """Return F and G of x+ = F x + G u over a tick with u held."""


class LinearPlant:
    """The small motions of a model about a rest, with the joints' and tips' readings.

    Args:
        model: equations of motion.
        rest: q about which it is linear, shape (positions,).
    """

    def __init__(self, model: Model, rest: Vector) -> None:
        linear = model.linearise(rest)
        n, modes = model.coordinates, model.modes
        self._a, self._b = linear.state_matrix, linear.state_input_matrix
        outputs, zero = rate_outputs(model, rest), np.zeros((model.joints, n))
        self.position: Matrix = np.hstack((outputs, zero))
        self.velocity: Matrix = np.hstack((zero, outputs))
        tips = model.appendages
        self.tip = np.zeros((len(tips.names), 2 * n))
        self.tip[:, n - modes : n] = tips.tip
        if tips.rate is not None:
            self.tip[:, 2 * n - modes :] = tips.rate

    def step(self, period: float) -> tuple[Matrix, Matrix]:
        """Return F and G of x+ = F x + G u over a tick with u held."""
        return zero_order_hold(self._a, self._b, period)


def collocated_loop(
    plant: SampledPlant, kp: Vector, kd: Vector, period: float, ki: Vector | None = None
) -> Matrix:
    """Return the map of one tick under u = s - kp position - kd velocity.

    s+ = s - period ki position, for the joints with an integral.

    Args:
        plant: 2 n states.
        kp: one gain per joint, shape (joints,).
        kd: of the same shape.
        period: [s].
        ki: of the same shape; none: no integral.

    Returns:
        of shape (2 n + integrals, 2 n + integrals).
    """
    gain = kp[:, None] * plant.position + kd[:, None] * plant.velocity
    integral = None if ki is None else period * ki[:, None] * plant.position
    return _with_integral(*plant.step(period), gain, integral, 1.0)


def integral_loop(
    linear: Linearisation, kp: Matrix, kd: Matrix, ki: Matrix | None, period: float | None
) -> Matrix:
    """Return the map of one tick under u = s - kp q - kd q', s+ = s - period ki q, all q known.

    Args:
        linear: M q'' + D q' + K q = B u.
        kp: shape (efforts, n).
        kd: of the same shape.
        ki: of the same shape; rows of zeros have no integral; none: there is none.
        period: [s]; None: the law acts all the time, and the matrix is that of the state's rate.

    Returns:
        of shape (2 n + integrals, 2 n + integrals).
    """
    a, b = linear.state_matrix, linear.state_input_matrix
    step, unit, stays = (a, b), 1.0, 0.0
    if period is not None:
        step, unit, stays = zero_order_hold(a, b, period), period, 1.0
    integral = None if ki is None else np.hstack((unit * ki, np.zeros_like(ki)))
    return _with_integral(*step, np.hstack((kp, kd)), integral, stays)


def _with_integral(
    f: Matrix, g: Matrix, gain: Matrix, integral: Matrix | None, stays: float
) -> Matrix:
    """Return the loop of x+ = f x + g u under u = s - gain x, s+ = stays s - integral x."""
    closed: Matrix = f - g @ gain
    if integral is None or not integral.any():
        return closed
    on = integral.any(axis=1)
    below = np.hstack((-integral[on], stays * np.eye(int(on.sum()))))
    return np.vstack((np.hstack((closed, g[:, on])), below))


def require_sampled_pd(
    model: Model,
    rest: Vector,
    kp: Vector,
    kd: Vector,
    period: float,
    what: str,
    ki: Vector | None = None,
    seen: Callable[[SampledPlant], SampledPlant] = lambda plant: plant,
) -> None:
    """Check a collocated law on a free platform, where modes are fast compared with a tick.

    Args:
        model: model of the bench.
        rest: q of the linearisation.
        kp: one gain per joint that is seen, shape (joints,).
        kd: rate gains, of the same shape.
        period: one tick [s].
        what: name of the checked law or gains, for the message.
        ki: integral gains, of the same shape; None: no integral.
        seen: returns the small motions that the law reads, from those of the joints; default: all.

    Raises:
        BadInput: see require_sampled_stability.
    """
    if model.leading is None or not (kp.any() or kd.any()):
        return
    plant = seen(LinearPlant(model, rest))
    require_sampled_stability(lambda h: collocated_loop(plant, kp, kd, h, ki), period, what)


def appendage_loop(
    plant: LinearPlant, observed: OneAppendage, found: SlidingDesign, period: float
) -> Matrix:
    """Return the map of one tick of plant and observer under output feedback control.

    Args:
        plant: 2 n states.
        observed: the appendage, k states.
        found: its surface and observer.
        period: [s].

    Returns:
        of shape (2 n + k, 2 n + k).
    """
    f, g = plant.step(period)
    surface, gain, system = found.surface, found.observer_gain, observed.system
    inverse = np.linalg.inv(surface @ system.b)
    by_y = -inverse @ surface @ gain
    by_z = -inverse @ surface @ (system.a - gain @ system.c)
    by_z = by_z - found.reaching_rate * inverse @ surface
    y = plant.tip[observed.rows]
    selection = np.zeros((observed.count, len(observed.joints)))
    selection[observed.joints, range(len(observed.joints))] = 1.0
    platform_mask = np.where(selection.any(axis=1), 0.0, 1.0)
    platform = -(platform_mask * observed.stiffness)[:, None] * plant.position
    platform = platform - (platform_mask * observed.damping)[:, None] * plant.velocity
    k, m = system.b.shape
    step = observer_step(system, gain, period)
    by_effort, by_output = step[:, k : k + m], step[:, k + m :]
    return np.block(
        [
            [f + g @ (platform + selection @ by_y @ y), g @ selection @ by_z],
            [(by_effort @ by_y + by_output) @ y, step[:, :k] + by_effort @ by_z],
        ]
    )


def radius(closed: Matrix) -> float:
    """Return the spectral radius."""
    return float(abs(np.linalg.eigvals(closed)).max())


def require_sampled_stability(
    closed: Callable[[float], Matrix], period: float, what: str, hint: str = ""
) -> None:
    """Check the map of one tick.

    Args:
        closed: from a period to the map of one tick.
        period: of the trial [s].
        what: is sampled, for the message.
        hint: what else to change.

    Raises:
        BadInput: gives the spectral radius and the longest period that works.
    """
    found = radius(closed(period))
    if found <= 1.0 + _CLOSE:
        return
    stable_period = _max_stable_period(closed, period)
    if stable_period is None:
        suggestion = f"no period down to {_MIN_PERIOD * period:.2g} s works"
    else:
        suggestion = f"the longest period that works is {stable_period:.2g} s"
    raise BadInput(
        f"{what} is not stable with a period of {period:g} s: the spectral radius of one tick is "
        f"{found:.8g}; {suggestion}{hint}"
    )


def _max_stable_period(closed: Callable[[float], Matrix], period: float) -> float | None:
    """Return the longest stable period below `period`, rounded down to two digits [s]."""
    high = period
    for _ in range(90):
        low = 0.9 * high
        if low < _MIN_PERIOD * period:
            return None
        if radius(closed(low)) <= 1.0 + _CLOSE:
            break
        high = low
    for _ in range(12):
        middle = 0.5 * (low + high)
        if radius(closed(middle)) <= 1.0 + _CLOSE:
            low = middle
        else:
            high = middle
    digits = 10.0 ** (np.floor(np.log10(low)) - 1.0)
    return float(np.floor(low / digits + 1e-9) * digits)
