"""What ten minutes of shaking tell: errors, bias, intervals, time and memory over many benches.

FLEXSLEW_BENCH_SEEDS=200 ./flexslew bench identification shakes 200 benches of each kind (200 is
what it takes without the variable), drawn at +-20 % stiffness and payload, .5 % damping, in closed
loop under a PD law, with white noise of a tenth of each signal (20 dB); SCOLE-S as shake_scole
does, for five minutes and with its own damping. FLEXSLEW_BENCH_KINDS names those to shake alone;
with FLEXSLEW_BENCH_KEEP=FILE every bench is kept in a line of that file, and a later call goes on
from there (delete it when the code has changed). The modes that count lie below half of the
excited band; damping counts where the record holds 60 periods.
"""

import json
import os
import resource
import sys
import time
from dataclasses import astuple
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import norm
from tests.lab.identification.shaken import bench, shaken, truth

from flexslew_lab.identification.modal.modes import Interval, ModalModel, identify_modes
from flexslew_lab.identification.physical_fit import fit_parameters
from flexslew_lab.identification.records.record import Record
from flexslew_lab.studies.experiment import record_flight
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.settings import plain

SEEDS, CHOSEN = "FLEXSLEW_BENCH_SEEDS", "FLEXSLEW_BENCH_KINDS"
KEPT = "FLEXSLEW_BENCH_KEEP"
_FITTED = tuple(
    f"parameters.{name}" for name in ("bending_stiffness", "hub_inertia_1", "hub_inertia_2")
)
_PERIODS = 60.0  # that a record must hold of a mode whose damping counts
_NEAR = 0.05  # relative distance within which a mode counts as found
KINDS: dict[str, dict[str, Any]] = {
    "oscillator": {
        "keys": {"kind": "floating_oscillator", "damping_ratio": 0.005},
        "plan": {"band": [0.1, 6.0], "largest_excursion": [0.2]},
        "gains": (np.array([0.5]), np.array([1.0])),
        "payload": False,
        "fitted": (),
    },
    "csa": {
        "keys": {"kind": "csa", "modes": 3, "damping_ratio": 0.005},
        "plan": {"band": [0.18, 14.0], "slope": 1.0, "largest_excursion": [0.001]},
        "gains": (np.array([460.0, 460.0]), np.array([920.0, 920.0])),
        "payload": True,
        "fitted": _FITTED,
    },
    "scole": {"trial": "shake_scole", "payload": True, "fitted": ()},
}


class Estimate(NamedTuple):
    """An estimate beside the truth."""

    name: str  # frequency, damping, inertia or stiffness, with its number
    found: Interval
    truth: float
    counts: bool  # whether a bound on its error is asked for

    @property
    def error(self) -> float:
        """Relative [-]."""
        return self.found.value / self.truth - 1.0

    @property
    def away(self) -> float:
        """Error in the standard deviations that its interval tells."""
        half = 0.5 * (self.found.high - self.found.low)
        return float((self.found.value - self.truth) / half * norm.ppf(0.975))

    @property
    def held(self) -> bool:
        """Whether its interval holds the truth."""
        return self.found.low <= self.truth <= self.found.high


class Identified(NamedTuple):
    """What a record told."""

    estimates: list[Estimate]
    missed: int  # modes
    extra: int  # modes that are none
    seconds: float  # processor time


def figures() -> dict[str, float]:
    """Return figures of each kind, over all its benches.

    *_frequency, _damping, _inertia, _stiffness: largest relative error [-].
    *_bias: largest mean error of a number, in standard deviations of that mean; of some ten
    numbers, 3 is chance.
    *_coverage: part of the 95 % intervals that hold the truth, of *_intervals.
    *_deviation: largest mean error, in standard deviations of a single estimate as it tells them.
    *_missed, _extra: modes below half of the band that were not found, or are none.
    *_seconds: largest processor time of a record, without its physical fit [s].
    """
    count = int(os.environ.get(SEEDS, "200"))
    found: dict[str, float] = {"identification_benches": count}
    chosen = [k for k in os.environ.get(CHOSEN, "").split(",") if k] or list(KINDS)
    for kind in chosen:
        campaign = _campaign(kind, count)
        values = _errors([one for record in campaign for one in record.estimates])
        values["missed"] = float(sum(record.missed for record in campaign))
        values["extra"] = float(sum(record.extra for record in campaign))
        values["seconds"] = max(record.seconds for record in campaign)
        found |= {f"identification_{kind}_{name}": value for name, value in values.items()}
    found["identification_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return found


def _campaign(kind: str, count: int) -> list[Identified]:
    """Return what each bench told, those of a kept file without shaking them again."""
    file = Path(os.environ[KEPT]) if KEPT in os.environ else None
    kept: dict[int, Identified] = {}
    lines = file.read_text().splitlines() if file is not None and file.exists() else []
    for line in lines:
        one = json.loads(line)
        if one.pop("kind") == kind:
            estimates = [Estimate(e[0], Interval(*e[1]), *e[2:]) for e in one.pop("estimates")]
            seed = one.pop("seed")
            kept[seed] = Identified(estimates, **one)
    for seed in range(count):
        if seed % 20 == 0:
            print(f"{kind}: {seed} of {count}", file=sys.stderr, flush=True)
        if seed not in kept:
            kept[seed] = told = _bench(KINDS[kind], seed)
            if file is not None:
                rows = [[e.name, astuple(e.found), e.truth, e.counts] for e in told.estimates]
                one = {"kind": kind, "seed": seed, **told._asdict(), "estimates": rows}
                with file.open("a") as out:
                    print(json.dumps(one), file=out)
    return [kept[seed] for seed in range(count)]


def _bench(kind: dict[str, Any], seed: int) -> Identified:
    """Return what the record of a drawn bench told."""
    rng = np.random.default_rng(seed)
    factors = [rng.uniform(0.8, 1.2) for _ in range(1 + kind["payload"])]
    if "trial" in kind:
        nominal, true, record, band = _flown(kind["trial"], factors, seed)
    else:
        nominal = bench(**kind["keys"])
        true, band = nominal.scaled(*factors), kind["plan"]["band"]
        record = shaken(true, kind["plan"], kind["gains"], rng, believed=nominal).record
    begin = time.process_time()
    model = identify_modes(record, band)
    seconds = time.process_time() - begin
    estimates, missed, extra = _modes(model, true, band[1])
    if kind["fitted"]:
        fit = fit_parameters(model, nominal, kind["fitted"])
        stiffness = true.parameters.bending_stiffness
        estimates.append(Estimate("stiffness", fit.parameters[0].value, stiffness, True))
    return Identified(estimates, missed, extra, seconds)


def _flown(
    name: str, factors: list[float], seed: int
) -> tuple[Any, Any, Record, tuple[float, float]]:
    """Return the bench of a shipped trial, the drawn one, its record and the band shaken."""
    shipped = read_trial(name, None)[0]
    true = shipped.testbed.scaled(*factors)
    own = {"testbed": plain(true), "seed": seed}
    values = override_values(plain(shipped) | own, {"plan.model": plain(shipped.testbed)})
    return shipped.testbed, true, *record_flight(trial_of_values(values, name))


def _modes(model: ModalModel, true: Any, high: float) -> tuple[list[Estimate], int, int]:
    """Return the estimates, modes missed and modes that are none."""
    frequencies, damping, rigid = truth(true)
    estimates, missed, matched = [], 0, set()
    for k, (w, zeta) in enumerate(zip(frequencies, damping, strict=True), 1):
        if w > 0.5 * high:
            continue
        mode = min(model.modes, key=lambda m: abs(m.frequency.value - w), default=None)
        if mode is None or abs(mode.frequency.value / w - 1.0) > _NEAR:
            missed += 1
            continue
        matched.add(mode.frequency.value)
        long = mode.periods >= _PERIODS
        estimates.append(Estimate(f"frequency_{k}", mode.frequency, w, True))
        estimates.append(Estimate(f"damping_{k}", mode.damping_ratio, zeta, long))
    for k, row in enumerate(model.inertia):
        estimates.append(Estimate(f"inertia_{k + 1}", row[k], rigid[k, k], True))
    below = [m for m in model.modes if m.frequency.value <= 0.5 * high]
    return estimates, missed, len(below) - len(matched)


def _errors(estimates: list[Estimate]) -> dict[str, float]:
    found: dict[str, float] = {}
    numbers: dict[str, list[Estimate]] = {}
    for one in estimates:
        numbers.setdefault(one.name, []).append(one)
    for quantity in ("frequency", "damping", "inertia", "stiffness"):
        errors = [abs(o.error) for o in estimates if o.counts and o.name.startswith(quantity)]
        if errors:
            found[quantity] = max(errors)
    found["deviation"] = max(abs(float(np.mean([o.away for o in g]))) for g in numbers.values())
    found["bias"] = max(_bias([one.error for one in group]) for group in numbers.values())
    modal = [one for one in estimates if one.name != "stiffness"]
    found["intervals"] = float(len(modal))
    found["coverage"] = float(np.mean([one.held for one in modal]))
    return found


def _bias(errors: list[float]) -> float:
    """Return the mean in standard deviations of it."""
    if len(errors) < 2:
        return 0.0
    return float(abs(np.mean(errors)) / (np.std(errors, ddof=1) / np.sqrt(len(errors))))
