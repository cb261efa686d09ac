"""A plan that shakes the bench, so that its log tells what it is made of."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from flexslew_control.law import PlantDescription, per_joint
from flexslew_control.plan import Plan
from flexslew_control.planners.entry import PlannerEntry
from flexslew_control.planners.excitation.signals import (
    Phases,
    chirp,
    impulse,
    lines_of,
    multisine,
    orthogonal,
    random_binary,
)
from flexslew_control.planners.progress import Progress
from flexslew_control.planners.slew import Feedback, Slew, slew_of
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, PerJoint, Positive, plain, section
from flexslew_plant.testbeds.model import Model

_BELOW, _ABOVE = 0.4, 2.5  # default band, in parts of the lowest and the highest frequency
_TRIES = 4  # of an amplitude that keeps the limits
_SMALL = 1e-3  # of the effort limits: the amplitude from which one within limits is scaled


@section
class Excitation:
    """The `plan` section for method excitation: joints stay where they are and are shaken."""

    goal: ClassVar[dict[str, float]] = {}  # no joint goes anywhere

    method: Literal["excitation"] = "excitation"
    signal: Literal["multisine", "chirp", "random_binary", "impulse"] = "multisine"
    model: dict[str, Any] | None = None  # keys of the testbed believed otherwise; null: none
    initial: dict[str, float] | None = None  # where joints rest [rad or m]; null: as the testbed
    joints: tuple[str, ...] | None = None  # that are shaken, each a record's input; null: all
    # lowest and highest frequency [rad/s]; null: around the modes believed
    band: tuple[Positive, Positive] | None = None
    resolution: Positive | None = None  # between lines [rad/s]; null: four periods an experiment
    slope: Annotated[float, Field(ge=-4.0, le=4.0)] = 0.0  # size of a line goes by frequency^slope
    phases: Phases = "optimised"
    amplitude: PerJoint | None = None  # peak of the shaking [N m or N]; null: within these limits:
    effort_share: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5  # of the effort limits
    largest_excursion: PerJoint = (0.02,)  # of a joint [rad or m]
    largest_tip: Positive | None = None  # deflection [m]; null: no limit
    taper: NonNegative = 5.0  # rise and fall at the ends [s]
    start: NonNegative = 0.0  # [s]
    duration: Positive = 600.0  # [s]
    seed: Annotated[int, Field(ge=0)] = 1  # of what is random
    feedback: Feedback | None = None  # that flies it; null: of the controller in charge


@dataclass(frozen=True)
class Experiments:
    """How the ticks of a shaking are divided: taper, experiments of whole periods, taper.

    Args:
        period: ticks of one period.
        repeated: periods of an experiment.
        count: experiments, one per joint that is shaken.
        taper: ticks of the rise, and of the fall.
        after: ticks at rest after the fall, to a whole duration.
    """

    period: int
    repeated: int
    count: int
    taper: int
    after: int


def plan_excitation(
    settings: Excitation,
    plant: PlantDescription,
    feedback: Feedback | None,
    progress: Progress | None = None,
) -> Plan:
    """Return the plan that shakes the joints in turn of phase, with the reference at rest.

    A multisine is orthogonal over the joints: as many experiments as joints, of whole periods each,
    so that frequency responses can be told apart line by line.

    Args:
        settings: the section.
        plant: what stands on the bench.
        feedback: gains of the controller in charge; None: it has no such gains.
        progress: not called: nothing is iterated for long.

    Raises:
        BadInput: no such joint, an empty band, or a duration of less than two periods.
    """
    whole = settings.model if settings.model is not None else plain(plant.testbed)
    slew = slew_of(replace(settings, model=whole), plant, feedback)
    model = slew.model
    shaken = _shaken(settings, model)
    band = _band(settings, slew)
    parts = _divided(settings, len(shaken), band, slew.period)
    share, size = settings.effort_share, slew.effort_limit.size
    unit = np.zeros((parts.taper * 2 + parts.count * parts.repeated * parts.period, size))
    unit[:, shaken] = _signal(settings, parts, band, slew.period)
    unit = np.vstack((unit, np.zeros((parts.after, size))))
    peak = share * slew.effort_limit
    if settings.amplitude is not None:
        names = tuple(model.joint_names[k] for k in shaken)
        given = np.zeros(size)
        given[shaken] = per_joint("plan: amplitude", settings.amplitude, names)
        effort, flown = given * unit, None
        over = given > slew.effort_limit
        if over.any():
            name = model.joint_names[int(np.argmax(over))]
            raise BadInput(
                f"plan: amplitude: {given[over][0]:g} is not allowed: {name} has "
                f"{slew.effort_limit[over][0]:g}"
            )
    else:
        effort, flown = _within(settings, slew, unit * slew.effort_limit, peak)
    return _plan(settings, slew, effort, band, parts, flown)


def _shaken(settings: Excitation, model: Model) -> list[int]:
    names = settings.joints or model.joint_names
    unknown = [name for name in names if name not in model.joint_names]
    if unknown or len(set(names)) < len(names):
        wrong = unknown[0] if unknown else next(n for n in names if names.count(n) > 1)
        raise BadInput(
            f"plan: joints: {wrong} is not allowed: name each of "
            f"{', '.join(model.joint_names)} at most once"
        )
    return [model.joint_names.index(name) for name in names]


def _band(settings: Excitation, slew: Slew) -> tuple[float, float]:
    highest = np.pi / slew.period / 2.0
    if settings.band is not None:
        low, high = settings.band
        if not low < high <= highest:
            raise BadInput(
                f"plan: band: [{low:g}, {high:g}] is not allowed: the second must be larger, and "
                f"at most {highest:.4g} rad/s (four ticks a period)"
            )
        return low, high
    rest = slew.model.rest(slew.named(slew.start))
    frequencies = slew.model.linearise(rest).frequencies
    if not frequencies.size:
        raise BadInput("plan: band: is missing: the model has no modes that could set it")
    return _BELOW * float(frequencies[0]), min(_ABOVE * float(frequencies[-1]), highest)


def _divided(settings: Excitation, joints: int, band: tuple[float, float], h: float) -> Experiments:
    ticks, taper = round(settings.duration / h), round(settings.taper / h)
    share = (ticks - 2 * taper) // joints
    if settings.resolution is None:
        period = share // 4
    else:
        period = round(2.0 * np.pi / settings.resolution / h)
    repeated = share // period if period > 0 else 0
    if repeated < 2 or not lines_of(band, period, h).size:
        lowest = 2.0 * np.pi / band[0]
        needed = 2.0 * joints * max(period * h, lowest) + 2.0 * settings.taper
        raise BadInput(
            f"plan: duration: {settings.duration:g} is not allowed: {joints} experiments of two "
            f"periods with lines in the band need {needed:.4g} s, or a coarser resolution"
        )
    return Experiments(
        period, repeated, joints, taper, ticks - 2 * taper - joints * repeated * period
    )


def _signal(
    settings: Excitation, parts: Experiments, band: tuple[float, float], h: float
) -> Matrix:
    """Return what shakes each joint, with a peak of 1, over all experiments and both tapers."""
    rng = np.random.default_rng(settings.seed)
    one = _one_period(settings, parts, band, h, rng)
    turns = orthogonal(parts.count)
    columns = []
    for joint in range(parts.count):
        periods = []
        for factor in turns[:, joint]:
            turned = np.fft.irfft(np.fft.rfft(one) * factor, parts.period)
            periods.append(
                np.tile(turned if abs(factor.imag) > 1e-9 else one * factor.real, parts.repeated)
            )
        whole = np.concatenate(periods)
        rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(parts.taper) + 0.5) / max(parts.taper, 1))
        before = np.resize(periods[0][::-1], parts.taper)[::-1] * rise
        after = np.resize(periods[-1], parts.taper) * rise[::-1]
        columns.append(np.concatenate((before, whole, after)))
    signal = np.column_stack(columns)
    return np.asarray(signal / np.abs(signal).max(axis=0))


def _one_period(
    settings: Excitation,
    parts: Experiments,
    band: tuple[float, float],
    h: float,
    rng: np.random.Generator,
) -> Vector:
    if settings.signal == "multisine":
        lines = lines_of(band, parts.period, h)
        size = (lines / lines[0]) ** settings.slope
        return multisine(lines, size, parts.period, settings.phases, rng)
    if settings.signal == "chirp":
        return chirp(band, parts.period, h)
    if settings.signal == "random_binary":
        return random_binary(band, parts.period, h, rng)
    return impulse(band, parts.period, h)


@dataclass(frozen=True)
class _Flown:
    """The largest values of a shaking that is flown on the believed model."""

    effort: Vector  # with the feedback, (joints,) [N m or N]
    excursion: Vector  # of the joints, (joints,) [rad or m]
    tip: float  # [m]


def _within(
    settings: Excitation, slew: Slew, effort: Matrix, peak: Vector
) -> tuple[Matrix, _Flown]:
    """Return the efforts scaled to the largest that keep the limits, and how they fly."""
    names = slew.model.joint_names
    room = per_joint("plan: largest_excursion", settings.largest_excursion, names)
    scale, flown = _SMALL, None
    for _ in range(_TRIES):
        flown = _fly(slew, scale * effort)
        used = max(
            float((flown.effort / peak).max()),
            float((flown.excursion / room).max()),
            flown.tip / settings.largest_tip if settings.largest_tip else 0.0,
        )
        if 0.98 < used <= 1.0:
            break
        scale *= 0.99 / used
    assert flown is not None
    return scale * effort, flown


def _fly(slew: Slew, effort: Matrix) -> _Flown:
    """Return the largest values when the believed model is shaken under its feedback."""
    model, h = slew.model, slew.period
    rest = model.rest(slew.named(slew.start))
    x = np.concatenate((rest, np.zeros(model.coordinates)))
    most, away, tip = np.zeros(effort.shape[1]), np.zeros(model.joints), 0.0
    tips = model.appendages.tip
    for k, push in enumerate(effort):
        position, rate = model.joint_state(x)
        error = position - slew.start
        total = push - slew.kp * error - slew.kd * rate
        total = np.clip(total, -slew.effort_limit, slew.effort_limit)
        x = model.advance(x, total, h, t=k * h)
        most, away = np.maximum(most, np.abs(total)), np.maximum(away, np.abs(error))
        tip = max(tip, float(np.abs(tips @ model.modal_state(x)[0]).max(initial=0.0)))
    return _Flown(most, away, tip)


def _plan(
    settings: Excitation,
    slew: Slew,
    effort: Matrix,
    band: tuple[float, float],
    parts: Experiments,
    flown: _Flown | None,
) -> Plan:
    ticks = len(effort)
    peaks = np.abs(effort).max(axis=0)
    crest = [float(np.abs(c).max() / np.sqrt(np.mean(c**2))) if c.any() else 0.0 for c in effort.T]
    summary = {
        "duration": settings.duration,
        "band": list(band),
        "period": parts.period * slew.period,
        "periods": parts.repeated,
        "experiments": parts.count,
        "taper": parts.taper * slew.period,
        "peak_effort": peaks.tolist(),
        "crest_factor": crest,
        "believes": slew.beliefs,
    }
    if flown is not None:
        summary |= {
            "predicted_peak_effort": slew.named(flown.effort),
            "predicted_excursion": slew.named(flown.excursion),
            "predicted_tip_deflection": flown.tip,
        }
    rest = np.tile(slew.start, (ticks + 1, 1))
    return Plan(
        method=settings.method,
        joint_names=slew.model.joint_names,
        start=settings.start,
        period=slew.period,
        position=rest,
        velocity=np.zeros_like(rest),
        effort=effort,
        state=np.zeros((ticks + 1, 0)),
        duration=settings.duration,
        request={
            **plain(settings),
            "model": plain(slew.testbed),
            "initial": slew.named(slew.start),
        },
        summary=summary,
    )


EXCITATION = PlannerEntry(Excitation, plan_excitation, slews=False)
