"""The style of a figure for each medium: its width, its fonts and the weight of its lines."""

import shutil
from typing import Any, NamedTuple

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import number_in
from flexslew_plant.near_names import spelling_hint

MM = 1e-3 / 0.0254  # inches in a millimetre
_LEAST, _MOST = 0.02, 1.0  # width of a figure [m]
_SERIF = (
    "Times New Roman",
    "Nimbus Roman",
    "TeX Gyre Termes",
    "STIXGeneral",
)  # the last is shipped
# for print without colour the first differ in dashes; red and green are no pair among them
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#000000", "#e69f00")
_DASHES = ("-", "--", "-.", ":")


class Medium(NamedTuple):
    """Where a figure is shown."""

    width: float  # [mm]
    panel: float  # height of a panel [mm]
    height: float  # of the figure, at most [mm]
    settings: dict[str, Any]  # of Matplotlib


def _medium(size: tuple[float, float, float], font: float, line: float, **more: Any) -> Medium:
    """Return a medium of a size [mm]; the font and the curves are that high and wide [pt]."""
    settings = {
        "font.size": font,
        "axes.labelsize": font,
        "xtick.labelsize": 0.9 * font,
        "ytick.labelsize": 0.9 * font,
        "legend.fontsize": 0.9 * font,
        "lines.linewidth": line,
        "axes.linewidth": 0.6 * line,
        "grid.linewidth": 0.4 * line,
        "xtick.major.width": 0.6 * line,
        "ytick.major.width": 0.6 * line,
    }
    return Medium(*size, settings | more)


_PRINT = {"font.family": "serif", "font.serif": _SERIF, "mathtext.fontset": "stix"}
MEDIA = {
    "ieee": _medium((88.0, 27.0, 230.0), 8.0, 0.9, **_PRINT),  # a column
    "ieee_wide": _medium((181.0, 30.0, 230.0), 8.0, 0.9, **_PRINT),  # both columns
    "elsevier": _medium((90.0, 27.0, 240.0), 8.0, 0.9, **_PRINT),
    "thesis": _medium((150.0, 40.0, 220.0), 10.0, 1.1, **_PRINT),
    "slides": _medium((250.0, 58.0, 140.0), 18.0, 2.2, **{"font.family": "sans-serif"}),
}


def medium_of(style: str, width: str | float | None) -> Medium:
    """Return a medium.

    Args:
        style: its name.
        width: another width, with its unit, such as `88 mm`; None: that of the medium.

    Raises:
        BadInput: if there is no such medium, or no figure is as wide.
    """
    if style not in MEDIA:
        words = f"{spelling_hint(style, MEDIA)}allowed: {', '.join(MEDIA)}"
        raise BadInput(words, key="--style", value=style)
    if width is None:
        return MEDIA[style]
    length = number_in(width, ["m"], "--width")
    if not _LEAST <= length <= _MOST:
        words = "from 20 mm to 1 m, with its unit, for example 88mm"
        raise BadInput(words, key="--width", value=width)
    return MEDIA[style]._replace(width=1e3 * length)


def settings_of(medium: Medium, latex: bool) -> dict[str, Any]:
    """Return the settings of Matplotlib for a medium.

    Args:
        medium: the medium.
        latex: whether LaTeX sets the text.

    Raises:
        BadInput: if LaTeX is to set it and is not installed.
    """
    from cycler import cycler

    if latex:
        missing = [name for name in ("latex", "dvipng") if shutil.which(name) is None]
        if missing:
            remedy = "apt-get install texlive-latex-extra cm-super dvipng, or leave it out"
            raise BadInput(f"--latex: needs {' and '.join(missing)}: {remedy}")
    count = len(_COLOURS) * len(_DASHES)
    return {
        **medium.settings,
        "text.usetex": latex,
        "axes.prop_cycle": cycler(color=[_COLOURS[k % len(_COLOURS)] for k in range(count)])
        + cycler(linestyle=[_DASHES[k % len(_DASHES)] for k in range(count)]),
        "axes.grid": True,
        "grid.color": "#d9d9d9",
        "axes.axisbelow": True,
        "legend.frameon": False,
        "figure.constrained_layout.use": True,
        "pdf.fonttype": 42,  # TrueType, as journals require
        "svg.hashsalt": "flexslew",  # the same file again from the same runs
        "savefig.dpi": 300,
    }
