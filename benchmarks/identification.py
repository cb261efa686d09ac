"""What ten minutes of shaking tell: errors, intervals, time and memory over many benches.

FLEXSLEW_IDENTIFY_SEEDS=200 ./flexslew bench identification shakes 200 benches of each kind, drawn
at +-20 % stiffness and payload, in closed loop with white noise of a tenth of each signal; without
the variable, 3.
"""

import os
import resource
import time
from typing import Any

import numpy as np
from tests.lab.identification.shaken import bench, shaken, truth

from flexslew_lab.identification.modes import ModalModel, identify_modes
from flexslew_lab.identification.physical_fit import fit_parameters

SEEDS = "FLEXSLEW_IDENTIFY_SEEDS"
_FITTED = tuple(
    f"parameters.{name}" for name in ("bending_stiffness", "hub_inertia_1", "hub_inertia_2")
)
_PERIODS = 60.0  # that a record must hold of a mode whose damping counts
KINDS: dict[str, dict[str, Any]] = {
    "oscillator": {
        "keys": {"kind": "floating_oscillator", "damping_ratio": 0.005},
        "plan": {"band": [0.1, 6.0], "largest_excursion": [0.2]},
        "gains": (np.array([0.5]), np.array([1.0])),
        "payload": False,
    },
    "csa": {
        "keys": {"kind": "csa", "modes": 3, "damping_ratio": 0.005},
        "plan": {"band": [0.18, 14.0], "largest_excursion": [0.001]},
        "gains": (np.array([460.0, 460.0]), np.array([920.0, 920.0])),
        "payload": True,
    },
}


def figures() -> dict[str, float]:
    """Return the worst errors of each kind and the part of the 95 % intervals that hold the truth.

    With the largest processor time of a record [s] and the memory of all together [MB].
    """
    count = int(os.environ.get(SEEDS, "3"))
    found: dict[str, float] = {"identification_benches": count}
    for kind, one in KINDS.items():
        nominal = bench(**one["keys"])
        errors: dict[str, list[float]] = {}
        for seed in range(count):
            rng = np.random.default_rng(seed)
            draw = [rng.uniform(0.8, 1.2), rng.uniform(0.8, 1.2)][: 1 + one["payload"]]
            true = nominal.scaled(*draw)
            experiment = shaken(true, one["plan"], one["gains"], rng, believed=nominal)
            begin = time.process_time()
            band = one["plan"]["band"]
            model = identify_modes(experiment.record, (band[0], band[1]))
            cost = {"seconds": time.process_time() - begin}
            if kind == "csa":
                fit = fit_parameters(model, nominal, _FITTED)
                stiffness = true.parameters.bending_stiffness
                cost["stiffness"] = abs(fit.parameters[0].value.value / stiffness - 1.0)
            for name, value in (_errors(model, true, band[1]) | cost).items():
                errors.setdefault(name, []).append(value)
        for name, values in errors.items():
            best = np.mean if name == "coverage" else np.max
            found[f"identification_{kind}_{name}"] = float(best(values))
    found["identification_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return found


def _errors(model: ModalModel, true: Any, highest: float) -> dict[str, float]:
    """Return the worst relative errors of a bench, and the part of its intervals that hold."""
    frequencies, damping, rigid = truth(true)
    wrong = {"frequency": 0.0, "damping": 0.0, "inertia": 0.0, "missed_modes": 0.0}
    held = []
    for w, zeta in zip(frequencies, damping, strict=True):
        if w > 0.5 * highest:
            continue
        near = [m for m in model.modes if abs(m.frequency.value / w - 1.0) < 0.05]
        if not near:
            wrong["missed_modes"] += 1.0
            continue
        mode = min(near, key=lambda m: abs(m.frequency.value - w))
        wrong["frequency"] = max(wrong["frequency"], abs(mode.frequency.value / w - 1.0))
        if mode.periods >= _PERIODS:
            away = abs(mode.damping_ratio.value / zeta - 1.0)
            wrong["damping"] = max(wrong["damping"], away)
        held += [
            mode.frequency.low <= w <= mode.frequency.high,
            mode.damping_ratio.low <= zeta <= mode.damping_ratio.high,
        ]
    for k, row in enumerate(model.inertia):
        wrong["inertia"] = max(wrong["inertia"], abs(row[k].value / rigid[k, k] - 1.0))
        held.append(row[k].low <= rigid[k, k] <= row[k].high)
    return wrong | {"coverage": float(np.mean(held))}
