"""What flies in a trial, in the order of a control engineer's questions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.analysis.linear_plant import continuous_plant, sampled_plant
from flexslew_control.analysis.loop import (
    Complex,
    ControlLoop,
    loop_of,
    unstable_poles,
    visible_poles,
)
from flexslew_control.analysis.loop_margins import (
    ChannelMargins,
    DiskMargins,
    LoopFrequencyResponse,
    channel_margins,
    disk_margins,
    frequency_response,
    peaks,
)
from flexslew_control.analysis.modes import Mode, natural_modes
from flexslew_control.analysis.rest import rest_of
from flexslew_control.analysis.rigid_motions import free_rigid_modes
from flexslew_control.controllers.probing.running_law import RunningLaw
from flexslew_control.plan import Plan
from flexslew_lab.analysis.trial_models import Point, moment_of, point_of, running_law_at
from flexslew_lab.json_text import finite
from flexslew_lab.short_values import short
from flexslew_lab.trial.trial import (
    Trial,
    active_controller,
    law_of,
    plan_of_trial,
    plant_of,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook

_ON_CIRCLE = 1e-6  # distance from the unit circle at which a pole is on it
_NEAR = 1.25  # ratio of frequencies within which a mode limits a margin [-]
ERRORS = (0.8, 1.0, 1.2)  # of stiffness and of payload, as factors [-]


@dataclass(frozen=True)
class Pole:
    """A pole of the closed sampled loop.

    Args:
        frequency: undamped [rad/s].
        damping: ratio [-]; negative: it grows.
        z: where it is, real and imaginary.
        strength: of its residues between efforts and sensors, of the strongest [-].
    """

    frequency: float
    damping: float
    z: tuple[float, float]
    strength: float


@dataclass(frozen=True)
class OtherPlant:
    """Margins of the loop on a plant that differs from the design model."""

    stiffness: float  # factor [-]
    payload: float  # factor [-]
    stable: bool
    alpha: float  # disk margin at the plant's input; 0: not stable
    delay: float  # smallest delay margin of a channel [s]


@dataclass(frozen=True, repr=False)
class Analysis:
    """A trial's loop about a rest: numbers, and what the page draws."""

    controller: str
    law: str
    point: Point
    running: RunningLaw
    loop: ControlLoop
    sweep: LoopFrequencyResponse
    modes: tuple[Mode, ...]
    poles: tuple[Pole, ...]
    stable: bool
    uncontrolled: tuple[str, ...]  # joints that show rigid motions with poles at z = 1
    efforts: tuple[ChannelMargins, ...]
    sensors: tuple[ChannelMargins, ...]
    disks: dict[str, DiskMargins]
    peaks: dict[str, tuple[float, float]]
    others: tuple[OtherPlant, ...]
    plan: Plan | None

    def __repr__(self) -> str:
        """Return one line: the controller, the number of poles, the margins."""
        return f"<Analysis of {self.controller}: {len(self.poles)} poles, {self.verdict}>"

    def _repr_html_(self) -> str:
        """Return the margins at the efforts, for notebooks; of a loop that has none, its poles."""
        if not self.stable:
            poles = ((short(p.frequency), short(p.damping)) for p in self.poles)
            return in_notebook(repr(self), ("frequency [rad/s]", "damping [-]"), poles)
        rows = (
            (
                c.name,
                f"{c.gain_down:.6g} to {c.gain_up:.6g}",
                f"{np.degrees(c.phase):.6g}",
                short(c.delay),
            )
            for c in self.efforts
        )
        return in_notebook(repr(self), ("effort", "gain", "phase [deg]", "delay [s]"), rows)

    @property
    def worst(self) -> OtherPlant | None:
        """The plant with the smallest disk margin; None where no loop is stable."""
        return min(self.others, key=lambda other: other.alpha, default=None)

    @property
    def verdict(self) -> str:
        """The result in a sentence: stable or not, the smallest margin, where, what limits it."""
        if not self.stable:
            growing = [pole for pole in self.poles if np.hypot(*pole.z) > 1.0 + _ON_CIRCLE]
            at = ", ".join(f"{pole.frequency:.3g} rad/s" for pole in growing[:3])
            return f"{self.statement}, so there are no margins" + (f"; it grows at {at}" * bool(at))
        parts = ["stable"]
        smallest = min(m for channel in self.efforts for m in _smallest_margins(channel))
        if np.isfinite(smallest.alpha):
            parts.append(
                f"the smallest margin is {smallest.words} of {smallest.channel} at "
                f"{smallest.frequency:.3g} rad/s, limited by {self._limit_at(smallest.frequency)}"
            )
        disk, delay = self.disks["input"].alpha, min(c.delay for c in self.efforts)
        parts.append(f"disk margin {disk:.3g} and delay margin {delay:.3g} s at the efforts")
        if (w := self.worst) is not None:
            worst = f"disk margin {w.alpha:.3g}" if w.stable else "not stable"
            parts.append(f"{worst} at stiffness x {w.stiffness:g} and payload x {w.payload:g}")
        return "; ".join(parts)

    def _limit_at(self, frequency: float) -> str:
        """Return what of the plant is at a frequency: a mode, or the motion of the rigid body."""
        near = (m for m in self.modes if abs(np.log(m.frequency / frequency)) < np.log(_NEAR))
        mode = min(near, key=lambda m: abs(m.frequency - frequency), default=None)
        if mode is not None:
            return f"the mode at {mode.frequency:.3g} rad/s"
        if any(m.frequency < frequency for m in self.modes):
            return "the phase lag of the loop between or above its modes"
        return "the rigid motion, below the modes"

    @property
    def statement(self) -> str:
        """Whether the loop is stable, in words."""
        if self.stable:
            return "stable"
        if not self.uncontrolled:
            return "not stable"
        is_unstable = any(np.hypot(*pole.z) > 1.0 + _ON_CIRCLE for pole in self.poles)
        names = ", ".join(self.uncontrolled)
        verb = "is" if len(self.uncontrolled) == 1 else "are"
        return f"{'not stable; ' if is_unstable else ''}marginal: {names} {verb} not controlled"

    def plain(self) -> dict[str, Any]:
        """Return the numbers as JSON holds them; what is infinite or has no value is null."""
        rest = self.point.rest
        found: dict[str, Any] = {
            "controller": self.controller,
            "law": self.law,
            "rest": rest.joints,
            "time": rest.time,
            "left_out": list(self.point.left_out),
            "warnings": list(self.point.warnings),
            "law_states": list(self.running.form.states),
            "law_mismatch": self.running.mismatch,
            "modes": [mode._asdict() for mode in self.modes],
            "poles": [asdict(pole) for pole in self.poles],
            "stable": self.stable,
            "verdict": self.verdict,
            "uncontrolled": list(self.uncontrolled),
            "efforts": [asdict(margins) for margins in self.efforts],
            "sensors": [asdict(margins) for margins in self.sensors],
            "disks": {name: asdict(disk) for name, disk in self.disks.items()},
            "peaks": {place: {"s": s, "t": t} for place, (s, t) in self.peaks.items()},
            "others": [asdict(other) for other in self.others],
            "worst": None if self.worst is None else asdict(self.worst),
        }
        numbers: dict[str, Any] = finite(found)
        return numbers


def loop_analysis(
    trial: Trial,
    source: str,
    controller: str | None = None,
    at: float | str | None = None,
    joints: Mapping[str, float | str] | None = None,
    plan: Plan | None = None,
    errors: Sequence[float] = ERRORS,
) -> Analysis:
    """Return what a controller of a trial does about a rest.

    Args:
        trial: what flies.
        source: its file, for an error.
        controller: which one; None: the one in charge then, see active_controller.
        at: simulated time [s], see point_of; None: the end of the manoeuvre, or the start where
            there is none or joints are given.
        joints: where they rest instead [rad or m], or with a unit.
        plan: that is flown; None: the trial's own.
        errors: factors of stiffness and payload of the other plants [-].

    Raises:
        BadInput: no such controller, or it has no linear form there.
        PlanFailed: there is no plan.
    """
    plan = plan or plan_of_trial(trial, predict=False)
    if at is None and not joints and plan is not None:
        at = plan.end
    name = controller or active_controller(trial, moment_of(at))
    if name not in trial.controllers:
        known = ", ".join(trial.controllers)
        raise BadInput(f"{source}: --controller: {name} is not in controllers; allowed: {known}")
    point = point_of(trial, at, joints, plan)
    section = trial.controllers[name] or {}
    running = running_law_at(trial, name, section, point, f"{source}: controllers.{name}")
    loop = loop_of(sampled_plant(point.rest, point.path, applied=True), running.form)
    if not loop.sensors:
        raise BadInput(f"{source}: {name} listens to no sensor there: it closes no loop")
    others = _plant_variants(trial, point, running, errors) if is_stable(loop) else ()
    law, _ = law_of(name, section)
    return _measured(name, law, point, running, loop, others, plan)


def _measured(
    name: str,
    law: str,
    point: Point,
    running: RunningLaw,
    loop: ControlLoop,
    others: tuple[OtherPlant, ...],
    plan: Plan | None,
) -> Analysis:
    sweep = frequency_response(loop)
    marginal, stable = free_rigid_modes(loop), is_stable(loop)
    rigid = (Pole(0.0, 0.0, (1.0, 0.0), 0.0),) * marginal.poles
    poles = tuple(p for p in poles_of(loop) if not rigid or abs(complex(*p.z) - 1.0) > _ON_CIRCLE)
    channels = (*loop.effort_names, *loop.sensor_names)
    places = {"input": loop.effort_names, "output": loop.sensor_names, "both": channels}
    margins = [channel_margins(sweep, channel) for channel in channels] if stable else []
    return Analysis(
        name,
        law,
        point,
        running,
        loop,
        sweep,
        natural_modes(continuous_plant(point.rest, point.path.actuator)),
        (*rigid, *poles),
        stable,
        marginal.joints,
        tuple(margins[: loop.efforts]),
        tuple(margins[loop.efforts :]),
        {place: disk_margins(sweep, names) for place, names in places.items()} if stable else {},
        {place: peaks(sweep, places[place]) for place in ("input", "output")} if stable else {},
        others,
        plan,
    )


def poles_of(loop: ControlLoop) -> tuple[Pole, ...]:
    """Return the poles that efforts move and sensors see, one of each pair, the slowest first.

    Those that make the loop unstable are among them though nothing there shows them, strength 0.
    """
    values, strengths = visible_poles(loop)
    hidden = [(z, 0.0) for z in unstable_poles(loop) if z not in values]
    found = []
    for z, strength in [*zip(values, strengths, strict=True), *hidden]:
        if z.imag < 0.0 or abs(z) < 1e-12:
            continue
        s = np.log(z) / loop.system.period
        size = float(abs(s))
        damping = float(-s.real / size) if size > 0.0 else 0.0
        found.append(Pole(size, damping, (float(z.real), float(z.imag)), float(strength)))
    return tuple(sorted(found, key=lambda pole: pole.frequency))


def is_stable(loop: ControlLoop) -> bool:
    """Return whether the loop returns every rigid motion and no pole that acts grows.

    See free_rigid_modes and unstable_poles.
    """
    return not unstable_poles(loop).size and not free_rigid_modes(loop).joints


def disk_margin(loop: ControlLoop) -> float:
    """Return the disk margin of a loop at its efforts [-]; 0: not stable."""
    if not is_stable(loop):
        return 0.0
    return disk_margins(frequency_response(loop), loop.effort_names).alpha


def _plant_variants(
    trial: Trial, point: Point, running: RunningLaw, errors: Sequence[float]
) -> tuple[OtherPlant, ...]:
    """Return the margins on plants with errors, the law as it is."""
    here, testbed = point.rest, plant_of(trial).testbed
    out = []
    for stiffness in errors:
        for payload in errors:
            try:
                other = testbed.scaled(stiffness, payload)
            except BadInput:  # it carries none
                continue
            rest = rest_of(other, here.joints, here.time)
            loop = loop_of(sampled_plant(rest, point.path, applied=True), running.form)
            if not is_stable(loop):
                out.append(OtherPlant(stiffness, payload, False, 0.0, 0.0))
                continue
            sweep = frequency_response(loop)
            delay = min(channel_margins(sweep, name).delay for name in loop.effort_names)
            alpha = disk_margins(sweep, loop.effort_names).alpha
            out.append(OtherPlant(stiffness, payload, True, alpha, float(delay)))
    return tuple(out)


def effort_columns(loop: ControlLoop, point: Point) -> Matrix:
    """Return B of efforts that disturb the plant, shape (states of the closed loop, efforts).

    They add to the efforts of the motors, behind their lags and delays, with the same friction.
    """
    motors = replace(point.path.actuator, lag=0.0)
    bare = sampled_plant(point.rest, replace(point.path, actuator=motors, gain=None, delay=None))
    found, n = np.zeros((len(loop.closed.a), loop.efforts)), 2 * point.rest.model.coordinates
    first = loop.closed.states.index(bare.states[0])
    found[first : first + n] = bare.b[:n]
    return found


def responses(analysis: Analysis, ticks: int) -> dict[str, Vector]:
    """Return what steps do: `by input`, shape (ticks, sensors), a name for each input.

    Inputs are a reference of a joint that steps by one [rad or m], and an effort of one [N m or N]
    that disturbs a joint.
    """
    loop = analysis.loop
    closed, disturbances = loop.closed, effort_columns(loop, analysis.point)
    out: dict[str, Vector] = {}
    references = [name for name in closed.inputs if name.startswith("reference.")]
    columns = [(name, closed.b[:, closed.inputs.index(name)],
                closed.d[:, closed.inputs.index(name)]) for name in references]  # fmt: skip
    for k, name in enumerate(loop.effort_names):
        name = name.replace("effort.", "disturbance.")
        columns.append((name, disturbances[:, k], 0.0 * closed.d[:, 0]))
    for name, column, direct in columns:
        x, rows = np.zeros(len(closed.a)), []
        for _ in range(ticks):
            rows.append((closed.c @ x + direct)[loop.efforts :])
            x = closed.a @ x + column
        out[name] = np.array(rows)
    return out


def residual_curve(plan: Plan, frequency: Vector) -> tuple[dict[str, Vector], bool]:
    """Return what a plan leaves in an oscillator of each frequency, by joint.

    |int u(t) e^(-i w t) dt| / int |u| dt of its feedforward, or of the acceleration of its
    reference where it has none: one is the worst that this effort could do, zero leaves nothing.

    Args:
        plan: of k ticks.
        frequency: shape (f,) [rad/s].

    Returns:
        the curves, and whether they are of the feedforward.
    """
    effort, has_feedforward = plan.effort, bool(plan.effort.any())
    if not has_feedforward:
        effort = np.diff(plan.velocity, axis=0)
    time = plan.period * (np.arange(len(effort)) + 0.5)
    phases: Complex = np.exp(-1j * np.outer(frequency, time))
    sample_gain = np.sinc(0.5 * frequency * plan.period / np.pi)
    curves = {}
    for name, column in zip(plan.joint_names, effort.T, strict=True):
        size = float(abs(column).sum())
        if size > 0.0:
            curves[name] = sample_gain * abs(phases @ column) / size
    return curves, has_feedforward


class _Margin(NamedTuple):
    """A margin of a channel."""

    alpha: float  # the largest disk margin that it allows
    words: str
    channel: str
    frequency: float  # [rad/s]


def _smallest_margins(channel: ChannelMargins) -> Iterator[_Margin]:
    """Yield the gain margins and the phase margin of a channel, with the disks that they allow.

    A gain margin g allows a disk of 2 |g - 1| / (g + 1), a phase margin p one of 2 tan(p / 2)
    (Seiler, Packard and Gahinet, An introduction to disk margins, 2020).
    """
    gains = ((channel.gain_up, channel.up_frequency), (channel.gain_down, channel.down_frequency))
    for gain, frequency in gains:
        allowed = 2.0 * abs(gain - 1.0) / (gain + 1.0) if np.isfinite(frequency) else np.inf
        yield _Margin(allowed, f"a gain margin of {gain:.3g}", channel.name, frequency)
    allowed = 2.0 * float(np.tan(0.5 * channel.phase)) if np.isfinite(channel.phase) else np.inf
    words = f"a phase margin of {np.degrees(channel.phase):.3g} deg"
    yield _Margin(allowed, words, channel.name, channel.phase_frequency)
