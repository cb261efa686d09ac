"""Whether plans with the fewest switches are the shortest of their family, and what they take.

Run as a programme (python benchmarks/time_optimal.py 1000) it draws goals, limits and parameters
at random and compares with Newton's method from many random starts.
"""

import sys
from dataclasses import replace
from statistics import median
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.structures import found_durations
from flexslew_control.planners.time_optimal.switching import linear_candidates, solve_durations
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.csa import CsaParameters, CsaTestbed
from flexslew_plant.testbeds.hub_with_appendages import HubTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import (
    FloatingOscillatorParameters,
    FloatingOscillatorTestbed,
)

_ALLOWED = 1e-6  # longer than the best of the reference [s]
_STARTS = {"floating_oscillator": 60, "csa": 60, "hub_with_appendages": 20}
_RUNS = 9


class Miss(NamedTuple):
    """A plan that is longer than a slew of the reference."""

    slew: BangBang
    planned: float  # [s]
    reference: float  # [s]


def random_slew(kind: str, rng: np.random.Generator) -> BangBang:
    """Return a slew of the testbed with goal, limit, parameters and damping drawn at random."""

    def about(value: float, times: float) -> float:
        return value * float(times ** rng.uniform(-1.0, 1.0))

    damping = float(rng.choice([0.0, rng.uniform(0.0, 0.1)]))
    testbed: Any
    if kind == "floating_oscillator":
        masses = FloatingOscillatorParameters(
            driven_mass=about(1.0, 3.0), free_mass=about(1.0, 3.0), stiffness=about(1.0, 5.0)
        )
        testbed = FloatingOscillatorTestbed(damping_ratio=damping, parameters=masses)
        goal, limit = about(1.0, 30.0), about(1.0, 5.0)
    elif kind == "csa":
        beams = CsaParameters(bending_stiffness=about(1500.0, 3.0), linear_density=about(0.2, 2.0))
        testbed = CsaTestbed(variant="printed", modes=1, damping_ratio=damping, parameters=beams)
        goal, limit = about(0.5, 10.0), about(100.0, 2.0)
    else:
        testbed = HubTestbed(damping_ratio=damping)
        goal, limit = about(0.7, 4.0), about(3.0, 4.0)
    model = testbed.model()
    start = np.zeros(2 * model.coordinates)
    return BangBang(model, 0, start, goal, limit, bool(rng.integers(2)))


def reference(slew: BangBang, rng: np.random.Generator, starts: int) -> float:
    """Return the least duration that Newton's method finds from random starts [s].

    The arcs of the linear slews, spoilt, and arcs of random lengths; antisymmetric without damping.
    """
    best, arcs = np.inf, 6 if slew.robust else 4
    linear = linear_candidates(slew, True, 4.0)
    antisymmetric = slew.mode[1] == 0.0
    rough = replace(slew, coarse=slew.robust)
    for k in range(starts):
        if k % 2:
            guess = linear[k % len(linear)] * rng.uniform(0.7, 1.4, arcs)
        else:
            guess = rng.exponential(1.0, arcs)
            guess *= rng.uniform(1.0, 1.5) * linear[0].sum() / guess.sum()
        if antisymmetric:
            guess = 0.5 * (guess + guess[::-1])
        found = solve_durations(rough, guess)
        if found is None or found.min() < 1e-6 or found.sum() > best - 1e-7:
            continue
        if antisymmetric and np.abs(found - found[::-1]).max() > 1e-6:
            continue
        exact: Vector | None = solve_durations(slew, found)
        if exact is not None and exact.min() > 0.0:
            best = min(best, float(exact.sum()))
    return best


def campaign(kind: str, count: int, seed: int) -> tuple[list[Miss], list[float]]:
    """Return the plans that the reference beats, and how long each took [s]."""
    rng = np.random.default_rng(seed)
    missed: list[Miss] = []
    times: list[float] = []
    found_durations(random_slew(kind, np.random.default_rng(0)))  # loads the compiled code
    for done in range(count):
        if done and not done % 50:
            print(f"{kind}: {done} plans, {len(missed)} beaten", flush=True)
        slew = random_slew(kind, rng)
        began = process_time()
        durations = found_durations(slew)
        times.append(process_time() - began)
        planned = float(durations.sum())
        best = reference(slew, rng, _STARTS[kind])
        if planned > best + _ALLOWED:
            missed.append(Miss(slew, planned, best))
    return missed, times


def figures() -> dict[str, float]:
    """Return what the fewest switches take, against a bare simulation of the slew's arcs.

    fewest_switches_*_ms: median over random robust slews [ms]; *_ratio: over the floor [-].
    """
    found = {}
    for kind in _STARTS:
        rng = np.random.default_rng(1)
        pairs = []
        for run in range(_RUNS + 1):
            slew = random_slew(kind, rng)
            began = process_time()
            durations = found_durations(slew)
            planned = process_time() - began
            if not run:  # the first one loads the compiled code
                continue
            began = process_time()
            slew.residual(durations)
            pairs.append((planned, max(process_time() - began, 1e-6)))
        found[f"fewest_switches_{kind}_ms"] = 1e3 * median(p for p, _ in pairs)
        found[f"fewest_switches_{kind}_ratio"] = median(p / floor for p, floor in pairs)
    return found


if __name__ == "__main__":
    plans = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    for name in sys.argv[2:] or _STARTS:
        beaten, taken = campaign(name, plans, 7)
        late = sorted(taken)[-max(1, plans // 100)]
        print(
            f"{name}: {len(beaten)} of {plans} plans are beaten; "
            f"median {1e3 * median(taken):.1f} ms, 99 % within {1e3 * late:.1f} ms, "
            f"all within {1e3 * max(taken):.1f} ms"
        )
        for one in beaten:
            print(f"  {one.planned:.6f} s, {one.reference:.6f} s: {one.slew}")
