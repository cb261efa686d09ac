"""How a testbed moves, and how its appendages are bent, at the start."""

from collections.abc import Iterable, Mapping
from dataclasses import field

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.settings import section
from flexslew_plant.testbeds.model import Coordinate, Model

_SAME = 1e-9  # largest difference of a joint's rate from the requested one, relative [-]
KEY = "initial_motion"


@section
class InitialMotion:
    """Rates and deflections at the start; what is not named is at rest and straight."""

    rates: dict[str, float] = field(default_factory=dict)  # by joint [rad/s or m/s]
    # angular velocity of a free platform along body axes [rad/s]
    body_rate: tuple[float, float, float] | None = None
    # velocity of a free platform's body origin along body axes [m/s]
    velocity: tuple[float, float, float] | None = None
    # speeds of reaction wheels relative to the platform, by wheel [rad/s]
    wheel_speeds: dict[str, float] = field(default_factory=dict)
    # by control moment gyro [rad]
    gimbal_angles: dict[str, float] = field(default_factory=dict)
    # modal coordinates mode_1, mode_2, ... as the testbed scales them [m]
    deflections: dict[str, float] = field(default_factory=dict)
    # rates of the modal coordinates mode_1, mode_2, ... [m/s]
    deflection_rates: dict[str, float] = field(default_factory=dict)
    # force at the tip by appendage, as its tip is named in the log: it bends the appendage with the
    # joints held, and is released at the start [N]
    plucked: dict[str, float] = field(default_factory=dict)

    def __hash__(self) -> int:
        """Of its values: a testbed, as a key of a cache, holds it."""
        parts = (tuple(v.items()) if isinstance(v, dict) else v for v in vars(self).values())
        return hash(tuple(parts))


def moving_state(motion: InitialMotion, model: Model, q: Vector, v: Vector) -> Vector:
    """Return [q, v] at the start with a motion added to a state without one.

    The rates of the leading coordinates are the smallest that give the joints the requested rates:
    with E the derivative of the joints' rates with respect to v, dv = E^+ (rates - E v).

    Args:
        motion: what is requested.
        model: of the testbed.
        q: positions at the start, appendages straight, shape (positions,).
        v: rates of the testbed's own, shape (n,).

    Raises:
        BadInput: a name is none of the testbed's, no motion has these rates, or a wheel is faster
            than its motor drives it.
    """
    q, v = q.copy(), v.copy()
    of_q, of_v = model.state_columns
    lead = model.before_modes
    modes = of_v[lead:]
    fixed = np.zeros(model.coordinates, dtype=bool)
    fixed[lead:] = fixed[list(model.gimbals)] = True
    named = (
        ("wheel_speeds", motion.wheel_speeds, _suffixed(of_v[:lead], "_wheel")),
        ("gimbal_angles", motion.gimbal_angles, _suffixed(of_v[:lead], "_gimbal")),
        ("body_rate", _triple(motion.body_rate), _prefixed(of_v[:lead], "body_rate_")),
        ("velocity", _triple(motion.velocity), _prefixed(of_v[:lead], "body_")),
        ("deflection_rates", motion.deflection_rates, {c.name: lead + k for k, c in _each(modes)}),
    )
    for key, values, places in named:
        for at, value in _placed(key, values, places):
            v[at], fixed[at] = value, True
    first_mode = model.positions - model.modes
    mode_places = {c.name: first_mode + k for k, c in _each(of_q[first_mode:])}
    for at, value in _placed("deflections", motion.deflections, mode_places):
        q[at] = value
    if motion.plucked:
        q[first_mode:] += _static_deflection(motion.plucked, model, q)
    if motion.rates:
        v[~fixed] += _smallest_rates(motion.rates, model, q, v, np.flatnonzero(~fixed))
    _require_driven_speeds(model, v)
    return np.concatenate((q, v))


def _static_deflection(forces: Mapping[str, float], model: Model, q: Vector) -> Vector:
    """Return the modal coordinates under forces at the tips, K q = Phi^T F, shape (modes,)."""
    units = {name: (k, unit) for k, name, unit in model.appendages.deflections}
    tips = {name: k for name, (k, unit) in units.items() if unit == "m"}
    force = np.zeros(model.modes)
    for at, value in _placed("plucked", forces, tips):
        force += value * model.appendages.tip[at]
    lead = model.before_modes
    stiffness = model.linearise(q).stiffness[lead:, lead:]
    return np.asarray(np.linalg.solve(stiffness, force))


def _smallest_rates(
    rates: Mapping[str, float], model: Model, q: Vector, v: Vector, free: Indices
) -> Vector:
    """Return the smallest change of the free entries of v that gives joints these rates."""
    joints = {name: k for k, name in enumerate(model.joint_names)}
    rows, requested = map(np.array, zip(*_placed("rates", rates, joints), strict=True))
    sensitivity = _rates_by_speed(model, q)[rows]
    missing = requested - sensitivity @ v
    change: Vector = np.linalg.pinv(sensitivity[:, free]) @ missing
    left = missing - sensitivity[:, free] @ change
    if abs(left).max() > _SAME * max(1.0, abs(requested).max()):
        worst = [*rates][int(abs(left).argmax())]
        words = "no motion of platform and hinges has these rates together"
        raise BadInput(words, key=f"testbed.{KEY}.rates.{worst}", value=rates[worst])
    return change


def _rates_by_speed(model: Model, q: Vector) -> Matrix:
    """Return the derivative of the joints' rates with respect to v, shape (joints, n)."""
    columns = [model.joint_state(np.concatenate((q, one)))[1] for one in np.eye(model.coordinates)]
    return np.array(columns).T


def _require_driven_speeds(model: Model, v: Vector) -> None:
    """Check that no wheel is faster than its motor drives it.

    Raises:
        BadInput: one is, with its limit.
    """
    for at, fastest in zip(model.spins.rate - model.positions, model.spins.fastest, strict=True):
        if abs(v[at]) > fastest:
            name = model.state_columns[1][at].name.removesuffix("_wheel")
            words = f"at most {fastest:g} rad/s, up to which its motor drives it"
            raise BadInput(words, key=f"testbed.{KEY}.wheel_speeds.{name}", value=float(v[at]))


def _placed(
    key: str, values: Mapping[str, float], places: Mapping[str, int]
) -> Iterable[tuple[int, float]]:
    """Yield where each value belongs.

    Raises:
        BadInput: a name has no place, with the names that have one.
    """
    for name, value in values.items():
        if name not in places:
            known = ", ".join(places)
            words = (
                f"{spelling_hint(name, [*places])}allowed: {known}"
                if known
                else "it has none of them"
            )
            raise BadInput(f"not in this testbed; {words}", key=f"testbed.{KEY}.{key}.{name}")
        yield places[name], value


def _suffixed(columns: tuple[Coordinate, ...], suffix: str) -> dict[str, int]:
    """Return places by name of the columns that end so."""
    return {c.name.removesuffix(suffix): k for k, c in _each(columns) if c.name.endswith(suffix)}


def _prefixed(columns: tuple[Coordinate, ...], prefix: str) -> dict[str, int]:
    """Return places by axis of the columns that begin so."""
    return {axis: k for axis in "xyz" for k, c in _each(columns) if c.name == prefix + axis}


def _triple(values: tuple[float, float, float] | None) -> dict[str, float]:
    """Return components by axis; empty: there are none."""
    return {} if values is None else dict(zip("xyz", values, strict=True))


def _each(columns: Iterable[Coordinate]) -> Iterable[tuple[int, Coordinate]]:
    return enumerate(columns)
