"""How long planning M1 takes, against a floor of bare simulations measured in the same run."""

from statistics import median
from time import perf_counter

import numpy as np

from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.gauss_newton import Options, optimize
from flexslew_control.planners.feedforward.manoeuvre import Manoeuvre, TerminalMap, substeps_for
from flexslew_control.planners.progress import ignore
from flexslew_plant.testbeds.csa import CsaTestbed

_RUNS = 41


def _maps(modes: int) -> tuple[TerminalMap, TerminalMap]:
    model = CsaTestbed(variant="printed", modes=modes).model()
    gains = np.array([460.0, 460.0]), np.array([920.0, 920.0])
    m1 = Manoeuvre(model, *gains, np.zeros(2), np.array([1.0, 0.5]), 25.0, "cubic")
    basis = Basis("hat", 9, 25.0)
    fine = substeps_for(m1, basis)
    return TerminalMap(m1, basis, (fine + 2) // 3), TerminalMap(m1, basis, fine)


def figures() -> dict[str, float]:
    """Return the median times to plan M1 from U = 0 to a relative change of 1e-6.

    plan_m1_1_mode_ms, plan_m1_3_modes_ms: with levenberg and exact sensitivities, compiled [ms].
    plan_m1_*_ratio: that over the floor, one bare simulation on the fine grid an update [-].
    """
    found: dict[str, float] = {}
    cases = {name: _maps(modes) for name, modes in (("1_mode", 1), ("3_modes", 3))}
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
    for run in range(_RUNS + 1):
        for name, maps in cases.items():
            start = perf_counter()
            optimum = optimize(maps, Options(), ignore)
            planned = perf_counter()
            for _ in optimum.history:
                maps[1].terminal_error(optimum.weights)
            if run:  # the first one loads the compiled code
                times[name].append((planned - start, perf_counter() - planned))
    for name, pairs in times.items():
        found[f"plan_m1_{name}_ms"] = 1e3 * median(p for p, _ in pairs)
        found[f"plan_m1_{name}_ratio"] = median(p / floor for p, floor in pairs)
    return found
