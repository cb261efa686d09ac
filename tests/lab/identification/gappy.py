"""Records of a free body with two modes, with samples missing and clocks that wander."""

from typing import NamedTuple

import numpy as np

from flexslew_lab.identification.modal.oscillators import Oscillator, double_integral
from flexslew_lab.identification.records.clocks import Effort, record_on_clocks
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Vector

H = 0.04  # [s]
BAND = (0.5, 9.0)  # [rad/s]
INERTIA = 33.0
MODES = (Oscillator(2.465, 0.01), Oscillator(5.1, 0.02))
RESIDUES = np.array([[0.012, 0.3], [0.006, -0.2]])  # of the joint and of the deflection
TRUTH = np.array([INERTIA, *(x for m in MODES for x in (m.frequency, m.damping_ratio))])
OUTPUTS = (
    Output("position.hub", "rad", Quantity.JOINT_POSITION, "hub"),
    Output("rate.hub", "rad/s", Quantity.JOINT_RATE, "hub"),
    Output("s", "m", Quantity.DEFLECTION),
)


class Loss(NamedTuple):
    """What is wrong with the log of an experiment.

    Args:
        missing: part of the rows that are missing [-].
        burst: most rows of a gap.
        clock: regular; jitter (10 % of a tick); irregular (a rate that wanders by 20 %, with
            jitter); uneven (steps of .3 to 1.7 ticks); apart (outputs on an uneven clock).
    """

    missing: float = 0.0
    burst: int = 1
    clock: str = "regular"


def lossy_record(loss: Loss, seed: int, ticks: int = 2000, past: bool = False) -> Record:
    """Return the record of an experiment whose log has lost rows.

    Args:
        loss: of the log.
        seed: of effort, noise, clock and gaps.
        ticks: of the experiment.
        past: whether an effort is stamped when it ends.
    """
    rng = np.random.default_rng((seed, 17))
    t = _clock(loss.clock, ticks, rng)
    effort = _excitation(t, rng)
    own = np.sort(rng.uniform(t[1], t[-1], ticks)) if loss.clock == "apart" else t
    union = np.unique(np.concatenate((t, own)))
    held = effort[np.clip(np.searchsorted(t, union[:-1], side="right") - 1, 0, ticks)]
    clean = _responses(held, np.diff(union))[np.isin(union, own)]
    noisy = clean + 0.1 * clean.std(axis=0) * rng.standard_normal(clean.shape)
    rows = _rows_left(loss, ticks + 1, rng)
    outputs = rows if own is t else _rows_left(loss, ticks, rng)
    stamped = np.concatenate((effort[:1], effort[:-1])) if past else effort
    return record_on_clocks(
        [Effort("hub", t[rows], stamped[rows], past)],
        [(o, own[outputs], noisy[outputs, k]) for k, o in enumerate(OUTPUTS)],
        None,
        "lossy",
    )


def _clock(kind: str, ticks: int, rng: np.random.Generator) -> Vector:
    t = H * np.arange(ticks + 1)
    if kind == "jitter":
        t = t + 0.1 * H * np.clip(rng.standard_normal(ticks + 1), -3.0, 3.0)
    if kind == "irregular":
        rate = 1.0 + 0.2 * np.sin(2.0 * np.pi * np.arange(ticks) / 300.0)
        t = np.concatenate(([0.0], np.cumsum(H * rate)))
        t = t + 0.05 * H * np.clip(rng.standard_normal(ticks + 1), -3.0, 3.0)
    if kind == "uneven":
        t = np.concatenate(([0.0], np.cumsum(H * rng.uniform(0.3, 1.7, ticks))))
    times: Vector = t - t[0]
    return times


def _excitation(t: Vector, rng: np.random.Generator) -> Vector:
    """Return a multisine of the band with white noise, as feedback of noisy sensors has it."""
    lines = np.arange(BAND[0], BAND[1], 2.0 * np.pi / t[-1])
    phases = rng.uniform(0.0, 2.0 * np.pi, lines.size)
    sines = np.sin(np.outer(t, lines) + phases).sum(axis=1)
    return np.asarray(sines / sines.std() + 0.1 * rng.standard_normal(t.size))


def _responses(effort: Vector, steps: Vector) -> np.ndarray:
    """Return position and rate of the joint and the deflection, from rest."""
    position, rate = (x[:, 0] / INERTIA for x in double_integral(effort[:, None], steps))
    deflection = np.zeros_like(position)
    for mode, (joint, tip) in zip(MODES, RESIDUES, strict=True):
        q, v = (x[:, 0] / mode.frequency**2 for x in mode.responses(effort[:, None], steps))
        position, rate, deflection = position + joint * q, rate + joint * v, deflection + tip * q
    return np.column_stack((position, rate, deflection))


def _rows_left(loss: Loss, rows: int, rng: np.random.Generator) -> np.ndarray:
    left = np.ones(rows, dtype=bool)
    while left.sum() > round((1.0 - loss.missing) * rows):
        begin = int(rng.integers(2, rows - 2))
        length = int(rng.integers(1, loss.burst + 1))
        left[begin : min(begin + length, rows - 2)] = False
    return left
