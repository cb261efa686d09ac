"""Error of the integration of order 8 over a run, and the steps in a tick that keep it small.

A step of length h multiplies a vibration x' = s x by R(s h) instead of e^(s h), with the weights a,
b of the scheme (Hairer and Wanner, Solving Ordinary Differential Equations II, IV.2):
    R(z) = 1 + z b^T (I - z a)^-1 1,    l(z) = log(R(z) e^-z).
Of an undamped vibration, z = i w h, Re l is the relative error of its amplitude in a step and Im l
that of its phase [rad]: 1.5e-6 and 2.3e-6 at w h = 1.5, 1.5e-3 and 5.1e-4 at w h = 3. After k steps
the error is |e^(k z)| |e^(k l) - 1| of the amplitude at the start.
"""

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.compiled.dynamics import STAGE_WEIGHTS, STAGES, STEP_WEIGHTS

BOUND = 0.01  # of a vibration's amplitude, largest error over a run [-]
COARSE = 1.5  # turn of the fastest mode in a tick above which a run has a warning [rad]
_LARGEST = 3.0  # turn in a step, up to which the error grows with the turn [rad]
_EXACT = 0.25  # turn in a step, up to which the error is rounding [rad]
MOST_STEPS = 100  # in a tick
UNBOUNDED_TICKS = 1e6  # ticks of a run without an end
DESIGN_DURATION = 100.0  # duration of the flight for which a law or a plan is designed [s]


def step_error(z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return l of a step, see above, shape of z (k,)."""
    inner = np.eye(STAGES) - z[:, None, None] * STAGE_WEIGHTS
    stages = np.linalg.solve(inner, np.ones((len(z), STAGES, 1)))[..., 0]
    step_gain = 1.0 + z * (stages @ STEP_WEIGHTS)
    error: NDArray[np.complex128] = np.log(step_gain * np.exp(-z))
    return error


def run_error(poles: NDArray[np.complex128], step: float, duration: float) -> float:
    """Return the largest error of a vibration over a run, of its amplitude at the start [-].

    Args:
        poles: of the small motions, shape (k,) [1/s].
        step: of the integration [s].
        duration: of the run [s].
    """
    z = poles * step
    z = z[abs(z) > _EXACT]
    if not z.size:
        return 0.0
    error, last = step_error(z), max(duration / step, 1.0)
    largest = 0.0
    # at the end of the run, and where the error of a vibration that fades is largest
    for k in (np.full(z.size, last), np.clip(1.0 / np.maximum(-z.real, 1e-300), 1.0, last)):
        decay = np.exp(np.minimum(k * z.real, 0.0))
        error_factor = np.exp(np.minimum(k * error.real, 100.0) + 1j * k * error.imag)
        largest = max(largest, float((decay * abs(error_factor - 1.0)).max()))
    return largest


def steps_per_tick(
    poles: NDArray[np.complex128], period: float, duration: float = DESIGN_DURATION
) -> int:
    """Return the fewest equal steps in a tick that keep the error over a run below BOUND.

    Args:
        poles: poles of the small motions, shape (k,) [1/s].
        period: one tick [s].
        duration: duration of the run [s]; 0: without an end.

    Raises:
        BadInput: it takes more than MOST_STEPS.
    """
    duration = duration or UNBOUNDED_TICKS * period
    max_frequency = float(abs(poles).max(initial=0.0))
    first = max(int(np.ceil(min(max_frequency * period / _LARGEST, MOST_STEPS + 1.0))), 1)
    for steps in range(first, MOST_STEPS + 1):
        if run_error(poles, period / steps, duration) <= BOUND:
            return steps
    max_period = rounded_down(_LARGEST * MOST_STEPS / max_frequency)
    while run_error(poles, max_period / MOST_STEPS, duration) > BOUND:
        max_period = rounded_down(0.98 * max_period)
    words = (
        f"too long for the fastest mode of {max_frequency:.4g} rad/s, which turns by "
        f"{max_frequency * period:.4g} rad in a tick; take at most {max_period:g} s, or fewer modes"
    )
    raise BadInput(words, key="period", value=period)


def rounded_down(period: float) -> float:
    """Return the largest number of two digits that is not above a period [s]."""
    digits = int(np.floor(np.log10(period))) - 1
    return float(f"{int(np.floor(period / 10.0**digits * (1.0 + 1e-12)))}e{digits}")
