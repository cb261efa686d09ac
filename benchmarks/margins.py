"""Margins proved: every built-in law on several testbeds, predicted beside flown.

FLEXSLEW_BENCH_LAWS and FLEXSLEW_BENCH_BEDS hold names to fly alone, with commas between them.
"""

import os
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.analysis.analysis import loop_analysis
from flexslew_lab.analysis.proof import Proof, verify_margins
from flexslew_lab.notebook import trial
from flexslew_plant.errors import BadInput

BEDS: dict[str, tuple[str, dict[str, float]]] = {
    "csa_0": ("m1", {}),
    "csa_05": ("m1", {"hub_pitch": 0.5}),
    "csa_1": ("m1", {"hub_pitch": 1.0}),
    "oscillator": ("time_optimal_oscillator", {}),
    "hub": ("time_optimal_hub", {}),
    "scole_s": ("scole_s_a", {}),
}

_CSA = (2 * [460.0], 2 * [15.0], 2 * [920.0])
# proportional, integral and derivative gains of each effort: a law's defaults are for a csa
GAINS: dict[str, tuple[list[float], list[float], list[float]]] = {
    "csa_0": _CSA, "csa_05": _CSA, "csa_1": _CSA,
    "oscillator": ([0.5], [0.02], [1.0]),
    "hub": ([20.0], [1.0], [20.0]),
    # x to yaw, then the torques at the mast's tip
    "scole_s": (6 * [460.0] + 3 * [0.5], 6 * [15.0] + 3 * [0.05], 6 * [920.0] + 3 * [1.0]),
}  # fmt: skip
_ROLL_OFF = 50.0  # of law `linear`, a PD behind a low-pass [rad/s]
_FAST = ("oscillator", "scole_s")  # where a regulator in continuous time is too fast for a tick


def figures() -> dict[str, float]:
    """Return counts and largest differences, relative, by testbed and law.

    *_disagree: poles and margins beyond what may differ.
    *_margin: largest difference of a margin, of the prediction [-].
    A law without a stable linear loop there has no figures; the run says why.
    """
    out: dict[str, float] = {}
    for bed, law, proof in _flights():
        name = f"{bed}_{law}"
        out[f"{name}_agree"] = proof.checks.count(True)
        out[f"{name}_disagree"] = proof.checks.count(False)
        off = [abs(m.flown / m.predicted - 1.0) for m in proof.margins]
        out[f"{name}_margin"] = max(off, default=0.0)
    return out


def _flights() -> Iterator[tuple[str, str, Proof]]:
    beds, laws = (_chosen("BEDS", tuple(BEDS)), _chosen("LAWS", tuple(CONTROLLERS)))
    for bed in beds:
        shipped, joints = BEDS[bed]
        own = trial(shipped).controllers
        for law in laws:
            values = own.get(law) or _settings(bed, law)
            keys = {"plan": None, "controllers": {law: values}, "active": law}
            try:
                what = trial(shipped, keys)
                yield bed, law, verify_margins(what, loop_analysis(what, bed, joints=joints))
            except BadInput as error:
                print(f"{bed}, {law}: {error}", file=sys.stderr, flush=True)


def _settings(bed: str, law: str) -> dict[str, Any]:
    """Return the section of a law that the trial of a testbed does not have."""
    kp, ki, kd = GAINS[bed]
    if law == "pd_feedforward":
        return {"kp": kp, "kd": kd}
    if law == "collocated_pid":
        return {"kp": kp, "ki": ki, "kd": kd}
    if law == "linear":
        eye, none = np.eye(len(kp)), np.zeros((len(kp), 2 * len(kp)))
        a, b = -_ROLL_OFF * eye, np.hstack((np.diag(kp), np.diag(kd)))
        system = {"a": a, "b": b, "c": _ROLL_OFF * eye, "d": none}
        return {"system": {key: value.tolist() for key, value in system.items()}}
    if law == "disturbance_minimisation" and bed in _FAST:
        return {"design": "sampled"}
    return {}


def _chosen(what: str, known: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names in an environment variable, or all."""
    given = os.environ.get(f"FLEXSLEW_BENCH_{what}", "")
    names = tuple(name for name in given.split(",") if name) or known
    for name in names:
        if name not in known:
            raise BadInput(f"FLEXSLEW_BENCH_{what}: {name}; allowed: {', '.join(known)}")
    return names
