"""What the sensors on the appendages read, as linear maps of the modes."""

import numpy as np

from flexslew_plant.testbeds.model import Appendages
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft


def tip_channels(craft: Spacecraft) -> Appendages:
    """Return three displacements of each tip along body axes, then their rates."""
    names: list[str] = []
    tip, rate, curvature = [], [], []
    for k, a in enumerate(craft.appendages):
        if a.shape is None:
            continue
        n, first = a.modes, craft.first_mode(k)
        rows = np.zeros((3, craft.modes))
        rows[:, first : first + n] = a.axes.T @ a.shape.tip.displacement
        bent = np.zeros((3, craft.modes))
        if a.shape.along is not None:
            bent[:2, first : first + n] = a.shape.along.spot(0.0).curvature
        names += [f"{a.name}_{axis}" for axis in "xyz"]
        names += [f"{a.name}_rate_{axis}" for axis in "xyz"]
        still = np.zeros_like(rows)
        tip += [rows, still]
        rate += [still, rows]
        curvature += [bent, still]
    empty = np.zeros((0, craft.modes))
    return Appendages(
        tuple(names),
        np.vstack([empty, *tip]),
        np.vstack([empty, *curvature]),
        np.vstack([empty, *rate]),
    )
