"""Draw the figures of the pages of controllers and planners: `python docs/make_pages.py [NAME...]`.

Each figure shows the flight of the page's example: joints with their reference, tips, efforts.
"""

import re
import shlex
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

import flexslew as fs
from flexslew_lab.trial.sources import read_trial

mpl.use("Agg")
from matplotlib import pyplot as plt

DOCS = Path(__file__).parent
PANELS = ("position", "tip", "effort")
POINTS = 1500  # at most, of a curve


def draw(page: Path) -> None:
    """Fly the example of a page and write its figure next to it."""
    command = re.search(r"^\./flexslew trial (.*)$", page.read_text(), re.MULTILINE)
    assert command is not None, page
    name, *words = shlex.split(command[1])
    flight = fs.fly(read_trial(name, words[1::2])[0])
    panels = [panel for panel in PANELS if panel in flight]
    figure, axes = plt.subplots(
        len(panels), sharex=True, figsize=(8.0, 1.9 * len(panels)), layout="constrained"
    )
    shown = slice(None, None, max(1, len(flight.time) // POINTS))
    for panel, axis in zip(panels, np.atleast_1d(axes), strict=True):
        names = flight.names(panel)
        if panel == "position":  # of the joints alone
            names = tuple(name.replace("reference", panel) for name in flight.names("reference"))
        for k, signal in enumerate(names):
            label = signal.partition(".")[2]
            axis.plot(flight.time[shown], flight[signal][shown], f"C{k % 10}", lw=1.2, label=label)
            if panel == "position":
                wanted = flight[f"reference.{label}"][shown]
                axis.plot(flight.time[shown], wanted, f"C{k % 10}", lw=0.9, ls="--")
        units = ", ".join(dict.fromkeys(flight.units[signal] for signal in names))
        axis.set_ylabel(f"{panel} [{units}]")
        axis.legend(frameon=False, fontsize=7, loc="upper right", ncols=2)
        axis.grid(alpha=0.25)
    axes[-1].set_xlabel("time [s]")
    figure.savefig(page.with_suffix(".png"), dpi=80)
    plt.close(figure)


def main(names: list[str]) -> None:
    """Draw the figures of the pages of these names, or of all."""
    for folder in ("controllers", "planners"):
        for page in sorted((DOCS / folder).glob("*.md")):
            if not names or page.stem in names:
                print(page.stem, flush=True)
                draw(page)


if __name__ == "__main__":
    main(sys.argv[1:])
