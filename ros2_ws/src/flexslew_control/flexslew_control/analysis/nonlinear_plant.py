"""The whole non-linear plant as a system that python-control simulates."""

from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_control.analysis.rest import rest_of
from flexslew_control.analysis.signals import in_control, inputs_of, outputs_of
from flexslew_plant.arrays import Vector
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.model import Model

if TYPE_CHECKING:
    import control


def nonlinear_system(testbed: Testbed, name: str = "plant") -> "control.NonlinearIOSystem":
    """Return x' = f(t, x, u) of a testbed with the sensors' readings as its outputs.

    States are q and then v, as the bench's truth has them; inputs and outputs as in signals, with
    a colon where the bench has a dot. The motors' limits and lag, which tick, are not in it.
    """
    import control

    model = testbed.model()
    names = [word.replace(" ", "_") for word in model.state_names]
    return control.NonlinearIOSystem(
        lambda t, x, u, params: model.derivative(
            np.asarray(x, dtype=np.float64), np.asarray(u, dtype=np.float64), t
        ),
        lambda t, x, u, params: sensor_outputs(model, x, u, t),
        inputs=in_control(inputs_of(model)),
        outputs=in_control(outputs_of(model)),
        states=names,
        name=name,
    )


def start_of(testbed: Testbed, joints: dict[str, float] | None = None) -> Vector:
    """Return [q, v] of a rest, for the start of a simulation."""
    return rest_of(testbed, joints).state


def sensor_outputs(model: Model, x: Any, effort: Any, t: float) -> Vector:
    """Return what the sensors read of a state, in the order of signals.outputs_of."""
    x, effort = np.asarray(x, dtype=np.float64), np.asarray(effort, dtype=np.float64)
    return np.concatenate(exact_readings(model, x, effort, t))
