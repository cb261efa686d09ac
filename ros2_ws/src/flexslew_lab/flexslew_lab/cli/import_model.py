"""Subcommand that makes an appendage of a finite element model."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.quantity import quantity
from flexslew_lab.cli.options.shared import Json
from flexslew_lab.cli.terminal import link, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.trial.outputs import check_output_file
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import is_quantity, number_in

_ENDINGS = (".yaml", ".yml", ".npz")  # of modal data


@dataclass(frozen=True)
class ReductionOptions:
    """How a finite element model is reduced to modal data."""

    boundary: Annotated[
        str,
        typer.Option(help="What the hinge holds: nodes `7,9-12`, node sets, planes `x=0`."),
    ] = ""
    modes: Annotated[int, typer.Option(help="How many, the slowest.")] = 8
    units: Annotated[
        str, typer.Option(help="Of the model: si, slug_ft_lb, mm_t_s or in_lbf_s.")
    ] = "si"
    origin: Annotated[
        str | None, typer.Option(help="Place x,y,z of the hinge; default: the boundary's centre.")
    ] = None
    tip: Annotated[
        int | None, typer.Option(help="Node that is reported as the tip; default: the farthest.")
    ] = None
    damping: Annotated[
        float | None,
        typer.Option(
            parser=quantity("-"), help="Ratio of all modes; default: the file's, or none."
        ),
    ] = None


@expand_options
def import_model(
    file: Annotated[
        Path,
        typer.Argument(
            help="Matrices: .npz, .mat, .op4, .op2, .pch, .inp of CalculiX; or modes: its .frd."
        ),
    ],
    reduction: ReductionOptions,
    to: Annotated[
        Path | None, typer.Option(help="Modal data to write, .yaml or .npz; a page beside it.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Reduce a finite element model to modal data of an appendage, and check it.

    Prints frequencies and effective masses, and what the modes leave out. The page draws the modes.

    Example: `./flexslew import panel.inp --boundary ROOT --modes 8 --to panel.yaml`
    """
    from flexslew_lab.finite_elements.modal_output import write_modal_data
    from flexslew_lab.finite_elements.page import import_page
    from flexslew_lab.finite_elements.tables import COLUMNS, mode_rows, plain, verdict
    from flexslew_lab.report.page import write_page
    from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
        ImportOptions,
    )
    from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
        import_model as imported,
    )

    page = None
    if to is not None:
        if to.suffix not in _ENDINGS:
            raise BadInput(f"ends in {', '.join(_ENDINGS)}", key="--to", value=str(to))
        page = to.with_suffix(".html")
        for path in (to, page):
            check_output_file(path, "--to", file)
    damping = reduction.damping
    if damping is not None and not 0.0 <= damping < 1.0:
        raise BadInput("0 to 1", key="--damping", value=damping)
    options = ImportOptions(
        tuple(entry.strip() for entry in reduction.boundary.split(",") if entry.strip()),
        reduction.modes,
        reduction.units,
        _place(reduction.origin, reduction.units),
        reduction.tip,
        damping,
    )
    found = imported(file, options)
    for words in found.doubts:
        print_message(f"warning: {words}")
    if as_json:
        print(json_text(plain(found)))
    else:
        print_message(verdict(found), "bold")
        print_table(COLUMNS, mode_rows(found))
    if to is not None and page is not None:
        write_modal_data(found.content, to)
        write_page(import_page(found, file.name), page)
        print_message(f"written {to} and {link(page)}")


def _place(text: str | None, units: str) -> tuple[float, float, float] | None:
    """Return a place of three numbers with commas between, in the units of the model."""
    if text is None:
        return None
    from flexslew_plant.testbeds.spacecraft.finite_elements.model import MODEL_UNITS

    length = MODEL_UNITS[units].length if units in MODEL_UNITS else 1.0
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3:
        raise BadInput("three numbers, as 0,0,0.5", key="--origin", value=text)
    x, y, z = (
        number_in(part, ("m",), "--origin") / (length if is_quantity(part) else 1.0)
        for part in parts
    )
    return x, y, z
