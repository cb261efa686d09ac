"""Figures of runs for a paper, by Matplotlib: units on the axes, a legend of what differs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_lab.publication.channels import ChannelPanel, LabelledRun, panels_of
from flexslew_lab.publication.media import MM, medium_of, settings_of
from flexslew_lab.trial.outputs import check_output_file
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("pdf", "svg", "png")
_MARGIN = 12.0  # of the height, for the time axis and the legend [mm]
_WITHOUT_DATE: dict[str, dict[str, Any]] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}


def draw_runs(
    runs: Sequence[LabelledRun],
    show: Sequence[str] = (),
    to: Path | None = None,
    style: str = "ieee",
    width: str | float | None = None,
    latex: bool = False,
) -> Figure:
    """Return a figure with one panel per channel over the same time axis, and save it.

    Args:
        runs: with their names in the legend.
        show: channels; see panels_of.
        to: file, PDF, SVG or PNG; None: it is not saved.
        style: medium; see MEDIA.
        width: width with its unit; None: that of the medium.
        latex: whether LaTeX sets the text.

    Raises:
        BadInput: if a channel, a style, a width or a file is not allowed.
        ModuleNotFoundError: if Matplotlib is not installed.
    """
    matplotlib = required("matplotlib")
    medium = medium_of(style, width)
    settings = settings_of(medium, latex)
    kind = "" if to is None else format_of(to, "--to", FORMATS)
    panels = panels_of([run.flight for run in runs], show)
    with matplotlib.rc_context(settings):
        height = min(medium.panel * len(panels) + _MARGIN, medium.height)
        figure = _figure(runs, panels, (medium.width, height), latex)
        if to is not None:
            to.parent.mkdir(parents=True, exist_ok=True)
            figure.savefig(to, format=kind, metadata=_WITHOUT_DATE.get(kind))
    return figure


def format_of(path: Path, option: str, formats: Sequence[str]) -> str:
    """Return the format of a file by the end of its name, after checking that it can be written.

    Raises:
        BadInput: if it is of none of these formats, or cannot be written.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in formats:
        words = f"a file that ends in {', '.join(f'.{one}' for one in formats)}"
        raise BadInput(words, key=option, value=str(path))
    check_output_file(path, option)
    return kind


def _figure(
    runs: Sequence[LabelledRun],
    panels: Sequence[ChannelPanel],
    size: tuple[float, float],
    latex: bool,
) -> Figure:
    """Return the drawn figure; its size is width and height [mm]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] * MM, size[1] * MM))
    grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, panel in zip(grid, panels, strict=True):
        for run in runs:
            for name in panel.names:
                label = run.label if len(runs) > 1 else _words(name.partition(".")[2])
                if name in run.flight.signals:
                    values = np.asarray(run.flight.signals[name])
                    axes.plot(run.flight.time, values, label=_set(label, latex))
                else:
                    axes.plot([], [], label=_set(label, latex))  # its colour stays its own
        axes.set_ylabel(_set(_axis(panel), latex))
        axes.margins(x=0.0)
        if len(runs) == 1 and len(panel.names) > 1:
            above = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
            axes.legend(ncols=min(len(panel.names), 4), **above)
    grid[-1].set_xlabel("time [s]")
    figure.align_ylabels(grid)
    if len(runs) > 1:
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=min(len(runs), 3))
    return figure


def _axis(panel: ChannelPanel) -> str:
    """Return the title of a y axis, on two lines where it names a part."""
    unit = f" [{panel.unit}]" if panel.unit else ""
    parts = (_words(panel.quantity), f"{_words(panel.part)}{unit}" if panel.part else unit.strip())
    return ("\n" if panel.part else " ").join(filter(None, parts))


def _words(name: str) -> str:
    return name.replace("_", " ")


def _set(text: str, latex: bool) -> str:
    """Return a text in which no letter is a command, of LaTeX or of Matplotlib."""
    return latex_text(text) if latex else text.replace("$", r"\$")


def latex_text(text: str) -> str:
    """Return a text for LaTeX, with its special letters escaped and powers of units raised."""
    special = {letter: f"\\{letter}" for letter in "#$%&_{}"}
    special |= {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    escaped = "".join(special.get(letter, letter) for letter in text)
    return re.sub(r"\\textasciicircum\{\}(-?\d+)", r"$^{\1}$", escaped)
