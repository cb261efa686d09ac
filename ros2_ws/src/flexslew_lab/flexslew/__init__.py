"""flexslew: slew a flexible spacecraft without ringing, from Python.

import flexslew as fs

flight = fs.fly(fs.trial("m1", {"testbed.modes": 5}))
flight["tip"], flight.metrics["residual_tip_deflection"]

trial, fly, read and sweep fly trials; Flight and Sweep are what comes back; laws, planners and
testbeds are the families; bench puts a trial on a Bench that is stepped by hand. plan, compare,
analyse, gains, identify and study are the commands of these names, prove is `analyse --prove`.
plot draws runs for a paper. save_law keeps a design of python-control for a trial file; minimal
leaves out of a model what nothing moves or sees.
"""

from flexslew_control import controllers as laws
from flexslew_control import planners
from flexslew_control.analysis.minimal import minimal
from flexslew_control.analysis.save_law import save_law
from flexslew_control.law import Estimate, Reference
from flexslew_control.plan import Plan
from flexslew_lab.flight import Flight
from flexslew_lab.front import analyse, bench, compare, gains, identify, plan, plot, prove, study
from flexslew_lab.notebook import fly, linear_model, nonlinear_model, read, trial
from flexslew_lab.sweep import Sweep, sweep
from flexslew_lab.trial.trial import Trial
from flexslew_plant import testbeds
from flexslew_plant.bench.bench import Bench
from flexslew_plant.errors import BadInput, FlexslewError, PlanFailed
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.version import VERSION

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
    "read",
    "save_law",
    "study",
    "sweep",
    "testbeds",
    "trial",
]
