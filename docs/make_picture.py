"""Draw docs/bench.png from a run's folder: `python docs/make_picture.py runs/<run>`.

The bench from above at four moments, and the tip with and without the planned feedforward.
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.testbeds.csa import beam

mpl.use("Agg")
from matplotlib import pyplot as plt


def main(run: Path) -> None:
    """Write the picture."""
    bag = BagReader(run / "bag")
    flown = bag.columns("/truth", {"tick", "position", "tip_deflection"})
    bare = BagReader(run / "without_feedforward").columns("/truth", {"tick", "tip_deflection"})
    trial = parse_trial(bag.trial_text, str(run))
    length, radius = trial.testbed.parameters.length, trial.testbed.parameters.hub_radius
    s = np.linspace(0.0, length, 80)
    shapes = beam(trial.testbed).shape(s)
    figure, (above, tip) = plt.subplots(
        1, 2, figsize=(11, 4.2), width_ratios=(1, 1.5), layout="constrained"
    )
    for time, shade in ((0.0, 0.25), (6.0, 0.5), (12.5, 0.75), (25.0, 1.0)):
        q = flown["position"][round(time / trial.period)]
        c, w = np.cos(q[1]), q[0]
        bend = q[2:] @ shapes
        for side in (1.0, -1.0):
            x, y = side * (s + radius) * c, side * bend
            above.plot(
                x * np.cos(w) - y * np.sin(w),
                x * np.sin(w) + y * np.cos(w),
                color="tab:blue",
                alpha=shade,
                lw=2.5,
                label=f"{time:g} s" if side > 0 else None,
            )
    above.add_patch(plt.Circle((0, 0), 2.0, color="goldenrod"))
    above.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="The bench from above")
    above.legend(frameon=False, loc="lower right")
    for columns, label in ((bare, "without feedforward"), (flown, "with the planned feedforward")):
        tip.plot(columns["tick"] * trial.period, columns["tip_deflection"][:, 0], label=label)
    tip.axvline(25.0, color="grey", lw=0.8, ls="--")
    tip.set(
        xlabel="t [s]",
        ylabel="tip deflection [m]",
        title="Yaw 0 to 1 rad, pitch 0 to 0.5 rad in 25 s",
    )
    tip.legend(frameon=False)
    figure.savefig(Path(__file__).parent / "bench.png", dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
