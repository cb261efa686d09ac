"""flexslew: slew a flexible spacecraft without ringing, from Python.

import flexslew as fs

flight = fs.fly(fs.trial("m1", {"testbed.modes": 5}))
flight["tip"], flight.metrics["residual_tip_deflection"]

trial, fly, read and sweep fly trials; Flight and Sweep are what comes back; laws(), planners()
and testbeds() list what there is; bench puts a trial on a Bench that is stepped by hand. plan,
compare, analyse, budget, gains, identify and study are the commands of these names, prove is
`analyse --prove`, prove_budget `budget --prove`, worst_case `analyse --guarantee`, tune
`tune-structure`. uncertain_model pulls uncertain parameters out of a plant. plot draws runs for a
paper. save_law keeps a design of python-control for a trial file; minimal leaves out of a model
what nothing moves or sees. A name is imported when it is used first.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from flexslew_plant.near_names import spelling_hint
from flexslew_plant.version import VERSION

if TYPE_CHECKING:
    from flexslew_control.analysis.minimal import minimal
    from flexslew_control.analysis.save_law import save_law
    from flexslew_control.law import Estimate, Reference
    from flexslew_control.plan import Plan
    from flexslew_lab.families import laws, planners, testbeds
    from flexslew_lab.flight import Flight
    from flexslew_lab.front import (
        analyse,
        bench,
        budget,
        compare,
        gains,
        identify,
        plan,
        plot,
        prove,
        prove_budget,
        study,
        tune,
        uncertain_model,
        worst_case,
    )
    from flexslew_lab.notebook import fly, linear_model, nonlinear_model, read, trial
    from flexslew_lab.sweep import Sweep, sweep
    from flexslew_lab.trial.trial import Trial
    from flexslew_plant.bench.bench import Bench
    from flexslew_plant.errors import BadInput, FlexslewError, PlanFailed
    from flexslew_plant.measurement import EffortCommand, Measurement

__version__ = VERSION

__all__ = [
    "BadInput",
    "Bench",
    "EffortCommand",
    "Estimate",
    "FlexslewError",
    "Flight",
    "Measurement",
    "Plan",
    "PlanFailed",
    "Reference",
    "Sweep",
    "Trial",
    "analyse",
    "bench",
    "budget",
    "compare",
    "fly",
    "gains",
    "identify",
    "laws",
    "linear_model",
    "minimal",
    "nonlinear_model",
    "plan",
    "planners",
    "plot",
    "prove",
    "prove_budget",
    "read",
    "save_law",
    "study",
    "sweep",
    "testbeds",
    "trial",
    "tune",
    "uncertain_model",
    "worst_case",
]

_HOMES = {  # modules that are imported when one of their names is used first
    "flexslew_control.analysis.minimal": ("minimal",),
    "flexslew_control.analysis.save_law": ("save_law",),
    "flexslew_control.law": ("Estimate", "Reference"),
    "flexslew_control.plan": ("Plan",),
    "flexslew_lab.families": ("laws", "planners", "testbeds"),
    "flexslew_lab.flight": ("Flight",),
    "flexslew_lab.front": (
        "analyse",
        "bench",
        "budget",
        "compare",
        "gains",
        "identify",
        "plan",
        "plot",
        "prove",
        "prove_budget",
        "study",
        "tune",
        "uncertain_model",
        "worst_case",
    ),
    "flexslew_lab.notebook": ("fly", "linear_model", "nonlinear_model", "read", "trial"),
    "flexslew_lab.sweep": ("Sweep", "sweep"),
    "flexslew_lab.trial.trial": ("Trial",),
    "flexslew_plant.bench.bench": ("Bench",),
    "flexslew_plant.errors": ("BadInput", "FlexslewError", "PlanFailed"),
    "flexslew_plant.measurement": ("EffortCommand", "Measurement"),
}


def __getattr__(name: str) -> object:
    """Return a public name, which is imported with what it needs.

    Raises:
        AttributeError: if there is no such name.
    """
    home = next((module for module, names in _HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(
            f"flexslew has no {name}; {spelling_hint(name, __all__)}see dir(flexslew)"
        )
    found: object = getattr(import_module(home), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Return the public names."""
    return [*__all__, "__version__"]
