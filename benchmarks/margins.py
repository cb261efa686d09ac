"""Margins proved: every built-in law on several testbeds, predicted beside flown.

FLEXSLEW_BENCH_LAWS and FLEXSLEW_BENCH_BEDS hold names to fly alone, with commas between them.
"""

import os
import sys
from collections.abc import Iterator
from typing import Any

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.analysis.analysis import analysed
from flexslew_lab.analysis.proof import Proof, proved
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

# where a law's own defaults, for a csa, are none: joints x to yaw, then the three of the mast's tip
_JOINT_GAINS = {"kp": 6 * [460.0] + 3 * [0.5], "kd": 6 * [920.0] + 3 * [1.0]}
SETTINGS: dict[tuple[str, str], dict[str, Any]] = {
    ("scole_s", "pd_feedforward"): _JOINT_GAINS,
    ("scole_s", "collocated_pid"): {**_JOINT_GAINS, "ki": 6 * [15.0] + 3 * [0.05]},
}


def figures() -> dict[str, float]:
    """Return counts and largest differences, relative, by testbed and law.

    *_disagree: poles and margins beyond what may differ.
    *_margin: largest difference of a margin, of the prediction [-].
    A law without a stable linear loop there has no figures; the run says why.
    """
    out: dict[str, float] = {}
    for bed, law, proof in _flights():
        name = f"{bed}_{law}"
        out[f"{name}_agree"] = proof.verdicts.count(True)
        out[f"{name}_disagree"] = proof.verdicts.count(False)
        off = [abs(m.flown / m.predicted - 1.0) for m in proof.margins]
        out[f"{name}_margin"] = max(off, default=0.0)
    return out


def _flights() -> Iterator[tuple[str, str, Proof]]:
    beds, laws = (_chosen("BEDS", tuple(BEDS)), _chosen("LAWS", tuple(CONTROLLERS)))
    for bed in beds:
        shipped, joints = BEDS[bed]
        own = trial(shipped).controllers
        for law in laws:
            values = own.get(law) or SETTINGS.get((bed, law), {})
            keys = {"plan": None, "controllers": {law: values}, "active": law}
            try:
                what = trial(shipped, keys)
                yield bed, law, proved(what, analysed(what, bed, joints=joints))
            except BadInput as error:
                print(f"{bed}, {law}: {error}", file=sys.stderr, flush=True)


def _chosen(what: str, known: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names in an environment variable, or all."""
    given = os.environ.get(f"FLEXSLEW_BENCH_{what}", "")
    names = tuple(name for name in given.split(",") if name) or known
    for name in names:
        if name not in known:
            raise BadInput(f"FLEXSLEW_BENCH_{what}: {name}; allowed: {', '.join(known)}")
    return names
