"""The subcommands for papers: figures, tables and animations of runs, and the archive of one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.quantity import quantity
from flexslew_lab.cli.options.shared import TrustOption
from flexslew_lab.cli.terminal import link, print_message
from flexslew_lab.progress import display_progress
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust


@dataclass(frozen=True)
class FigureOptions:
    """The figure of the curves."""

    show: Annotated[
        str, typer.Option(help="Channels, with commas: tip,effort.yaw; default: the main ones.")
    ] = ""
    to: Annotated[Path | None, typer.Option(help="The figure: .pdf, .svg or .png.")] = None
    style: Annotated[str, typer.Option(help="ieee, ieee_wide, elsevier, thesis or slides.")] = (
        "ieee"
    )
    width: Annotated[str | None, typer.Option(help="Width in place of the style's: 88mm.")] = None
    label: Annotated[
        list[str] | None, typer.Option(help="Name of a run in the legend; one for each run.")
    ] = None
    latex: Annotated[bool, typer.Option("--latex", help="LaTeX sets the text.")] = False


@dataclass(frozen=True)
class TableOptions:
    """The table of metrics."""

    table: Annotated[Path | None, typer.Option(help="Metrics as a table: .tex or .csv.")] = None
    metrics: Annotated[
        str, typer.Option(help="Rows of the table, with commas; default: the main ones.")
    ] = ""


@dataclass(frozen=True)
class AnimationOptions:
    """The animation of one run."""

    animation: Annotated[
        Path | None, typer.Option(help="The moving testbed of one run: .gif or .mp4.")
    ] = None
    seconds: Annotated[
        float, typer.Option(parser=quantity("s"), help="Length of the animation [s].")
    ] = 10.0


@expand_options
def figure(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs, or bags.")],
    drawing: FigureOptions,
    numbers: TableOptions,
    movie: AnimationOptions,
    trust: TrustOption = None,
) -> None:
    """Draw runs for a paper: curves with units, a table of metrics, an animation.

    The legend names the keys of the trials that differ between the runs.

    Example: `./flexslew figure runs/a runs/b --show tip,effort --to f.pdf`
    """
    from flexslew_lab.named import names_in
    from flexslew_lab.publication.animation import write_animation
    from flexslew_lab.publication.channels import labelled_runs
    from flexslew_lab.publication.figure import draw_runs
    from flexslew_lab.publication.metric_table import write_metric_table

    to, table, animation = drawing.to, numbers.table, movie.animation
    if to is None and table is None and animation is None:
        raise BadInput("give at least one of --to, --table and --animation")
    if animation is not None and len(runs) > 1:
        raise BadInput("--animation: shows one run; give one")
    trusted = Trust.of(trust or ())
    with display_progress("figure", words="reading the runs"):
        if to is not None or table is not None:
            read_runs = labelled_runs(runs, drawing.label or (), trusted)
        if to is not None:
            channels = names_in(drawing.show)
            draw_runs(read_runs, channels, to, drawing.style, drawing.width, drawing.latex)
        if table is not None:
            write_metric_table(read_runs, table, names_in(numbers.metrics))
        if animation is not None:
            write_animation(runs[0], animation, movie.seconds, trust=trusted)
    for path in filter(None, (to, table, animation)):
        print_message(f"written {link(path)}")


def archive(
    run: Annotated[Path, typer.Argument(help="Folder of a run, or a bag.")],
    to: Annotated[
        Path | None, typer.Option(help="New folder, or a file .zip; else archive/ and its name.")
    ] = None,
    author: Annotated[
        list[str] | None, typer.Option(help="Name, or 'Name <https://orcid.org/...>'; repeatable.")
    ] = None,
    licence: Annotated[
        str, typer.Option(help="Licence of the data, as SPDX names it: CC-BY-4.0.")
    ] = "",
    about: Annotated[str, typer.Option(help="What the run shows, in a sentence.")] = "",
    trust: TrustOption = None,
) -> None:
    """Pack a run as an RO-Crate for a repository with a DOI: trial, log, plan, hashes, versions.

    Example: `./flexslew archive runs/m1-20260101-120000 --to m1.zip`
    """
    from flexslew_lab.cli.log import run_name
    from flexslew_lab.publication.archive import Statement, write_archive

    target = to or Path("archive", run_name(run))
    stated = Statement(author or (), licence, about)
    with display_progress("archive", words="packing"):
        written = write_archive(run, target, stated, print_message, Trust.of(trust or ()))
    print_message(f"written {link(written)}")
