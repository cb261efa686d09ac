"""What can be computed again: `flexslew reproduce NAME`. A new one is a file and a line here."""

import re
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from flexslew_plant.errors import BadInput

if TYPE_CHECKING:
    from flexslew_lab.report.panels import Group

_NUMBER = re.compile(r"^[-+]?\d[\d.e+-]*( %)?$")


class Reproduction(NamedTuple):
    """Numbers and figures of a paper; imported on request."""

    about: str
    module: str
    rows_name: str
    figures_name: str = ""

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of rows.KEYS.

        `paper` is the number that the paper prints, or `not printed`.
        """
        rows: list[dict[str, Any]] = self._function(self.rows_name)()
        return [
            {**row, "paper": row["paper"] if _NUMBER.match(str(row["paper"])) else "not printed"}
            for row in rows
        ]

    @property
    def figures(self) -> "Callable[[], dict[str, Group]] | None":
        """The function that gives figures by name; None where there are none."""
        return self._function(self.figures_name) if self.figures_name else None

    def _function(self, name: str) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(
            import_module(f"flexslew_lab.reproduce.{self.module}"), name
        )
        return function


REPRODUCTIONS: dict[str, Reproduction] = {
    "csa": Reproduction(
        "the CSA testbed, its gains and optimized feedforward (Gorinevsky and Vukovich, 1998)",
        "csa",
        "csa_rows",
        "csa_figures",
    ),
    "time-optimal": Reproduction(
        "time-optimal and robust slews (Liu and Singh, 1997)",
        "time_optimal",
        "time_optimal_rows",
        "time_optimal_figures",
    ),
    "optimum": Reproduction(
        "the least vibration of a bounded drive (Liu and Wie, 1992; convex programs)",
        "optimum",
        "optimum_rows",
    ),
    "scole": Reproduction(
        "SCOLE under output feedback control (Sung and Joo), in space",
        "scole",
        "scole_rows",
        "scole_figures",
    ),
    "ofc": Reproduction("output feedback control (Sung and Joo)", "laws", "ofc_rows"),
    "antennas": Reproduction(
        "retargeting flexible antennas (Kwak, 1989)",
        "antennas",
        "antennas_rows",
        "antennas_figures",
    ),
    "pi": Reproduction("PI control with an estimator (Kwak, 1989)", "pi", "pi_rows"),
}


def write_figures(name: str, path: Path) -> None:
    """Write the figures of a reproduction as one self-contained page.

    Args:
        name: a key of REPRODUCTIONS.
        path: the HTML file.

    Raises:
        BadInput: it has no figures.
    """
    from flexslew_lab.report.page import write_page
    from flexslew_lab.report.sections import page_of_sections

    draw = REPRODUCTIONS[name].figures
    if draw is None:
        names = ", ".join(key for key, entry in REPRODUCTIONS.items() if entry.figures_name)
        raise BadInput(f"{name} has no figures; allowed: {names}")
    groups = [
        replace(group, title=title.replace("_", " ").capitalize())
        for title, group in draw().items()
    ]
    write_page(page_of_sections("reproduce", name, REPRODUCTIONS[name].about, groups), path)
