"""Subcommand that identifies a bench from logs of its experiments."""

import os
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.quantity import numbers_in, quantity
from flexslew_lab.cli.options.shared import Json, TrustOption
from flexslew_lab.cli.terminal import for_people, link, print_message, print_table
from flexslew_lab.json_text import json_text
from flexslew_lab.trial.outputs import bag_folder, check_output_file, new_folder
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust

if TYPE_CHECKING:
    from flexslew_lab.identification.identification import Experiment
    from flexslew_lab.identification.modal.modes import ModalModel
    from flexslew_lab.identification.next_plan import NextPlan

MODEL, PAGE, APPENDAGE = "identified.yaml", "identification.html", "appendage.yaml"
UNIVERSAL = (".uff", ".unv", ".58")
_STAMPS = ("header", "recorded")  # of a bag's messages


@dataclass(frozen=True)
class FitOptions:
    """What is fitted, and in which band."""

    fit: Annotated[
        str | None, typer.Option(help="Keys of the testbed to fit, with commas between.")
    ] = None
    start: Annotated[
        list[str] | None, typer.Option(help="key=value, where a fit begins; may be repeated.")
    ] = None
    band: Annotated[
        str | None, typer.Option(help="Band low,high [rad/s]; default: that of the excitation.")
    ] = None


@dataclass(frozen=True)
class RecordOptions:
    """The columns, times and efforts of a file of another bench."""

    inputs: Annotated[
        str | None, typer.Option(help="Columns of efforts in a file of another bench.")
    ] = None
    outputs: Annotated[str | None, typer.Option(help="Columns of sensors in that file.")] = None
    period: Annotated[
        float | None,
        typer.Option(parser=quantity("s"), help="Its sampling period [s]; default: the median."),
    ] = None
    past: Annotated[
        bool, typer.Option("--past", help="Efforts are stamped when they end, not when they begin.")
    ] = False
    hold: Annotated[
        str | None,
        typer.Option(help="Efforts between samples: held, or band-limited; default: as it shows."),
    ] = None
    time: Annotated[
        str | None, typer.Option(help="Its column of times; default: time, t or stamp.")
    ] = None
    time_unit: Annotated[
        str | None, typer.Option(help="Unit of its times: s, ms, us or ns; default: s.")
    ] = None
    stamps: Annotated[str, typer.Option(help="Times of a bag: header, or recorded.")] = "header"

    @property
    def are_unnamed(self) -> bool:
        """Whether no column is named."""
        return self.inputs is None and self.outputs is None


@dataclass(frozen=True)
class OutputOptions:
    """The files that are written besides the model."""

    system: Annotated[
        Path | None, typer.Option(help="Also a linear system: .mat, .npz or .json.")
    ] = None
    appendage: Annotated[
        str | None,
        typer.Option(help="joint=axis,...: also modal data for a spacecraft."),
    ] = None
    uff: Annotated[
        Path | None, typer.Option(help="Also responses and modes as a universal file: .uff, .unv.")
    ] = None
    mass: Annotated[
        float | None,
        typer.Option(
            parser=quantity("kg"),
            help="Of an appendage [kg]: the modes of a universal file as modal data.",
        ),
    ] = None


@expand_options
def identify(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Runs or bags; the first gives the model, the others prove it."),
    ],
    *,
    fitting: FitOptions,
    columns: RecordOptions,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; else the run's.")] = None,
    also: OutputOptions,
    replan: Annotated[
        bool,
        typer.Option(help="Residual of a slew on the model found, and of a new plan."),
    ] = False,
    trust: TrustOption = None,
    as_json: Json = False,
) -> None:
    """Identify modes, inertias and parameters of a bench from what its sensors measured.

    Leaves identified.yaml, which `plan.model: {file: ...}` believes, and a page. Of a CSV file or
    a rosbag2 of another bench, name the columns: `--inputs "u=hub" --outputs "x=position.hub"`.

    Example: `./flexslew identify runs/shake --fit parameters.bending_stiffness`
    """
    from flexslew_lab.identification.identification import identify as identified
    from flexslew_lab.identification.model_file import (
        appendage_file_text,
        file_text,
        save_system,
        write_model,
    )
    from flexslew_lab.identification.page import identification_page, summary_rows, verdict
    from flexslew_lab.report.page import write_page

    uff, system, appendage = also.uff, also.system, also.appendage
    if columns.are_unnamed and runs[0].suffix.lower() in UNIVERSAL:
        given: dict[str, object] = {
            "--fit": fitting.fit,
            "--start": fitting.start,
            "--replan": replan,
            "--system": system,
            "--appendage": appendage,
            "--past": columns.past,
            "--period": columns.period,
            "--time": columns.time,
            "--time-unit": columns.time_unit,
            "--hold": columns.hold,
        }
        _require_none(runs, given)
        _identify_universal(runs[0], _band(fitting.band), also, out, as_json)
        return
    if also.mass is not None:
        raise BadInput("--mass belongs to a universal file with modes", runs[0])
    if uff is not None:
        check_output_file(uff, "--uff")
    _require_known(columns)
    experiments = [_experiment(run, columns, trust) for run in runs]
    folder = out or _output_folder(runs[0])
    for name in (MODEL, PAGE):
        check_output_file(folder / name, "--out")
    if system is not None:
        check_output_file(system, "--system")
    with for_people.status("identifying") as status:
        found = identified(
            experiments,
            _band(fitting.band),
            tuple(key.strip() for key in fitting.fit.split(",")) if fitting.fit else (),
            _starts(fitting.start),
            status.update,
        )
    better = _next(runs[0], experiments[0], found.model, trust) if replan else None
    text, without_model = file_text(
        found.model, None if found.physical is None else found.physical.changes
    )
    modal = None if appendage is None else appendage_file_text(found.model, _axes(appendage))
    write_model(folder / MODEL, text)
    if modal is not None:
        write_model(folder / APPENDAGE, modal)
    page = write_page(identification_page(found), folder / PAGE)
    if system is not None:
        save_system(found.model, system)
    if uff is not None:
        from flexslew_lab.identification.responses.universal import write_model as write_universal

        write_universal(uff, found.model, found.response)
    if as_json:
        plan_values = {"next_plan": None if better is None else better._asdict()}
        print(json_text(found.plain() | plan_values))
    else:
        print_table(("", runs[0].name), summary_rows(found))
        print_message(verdict(found), "bold")
        if better is not None:
            print_message(
                f"on the bench as found, the plan that was flown leaves {better.flown:.3g} m at "
                f"the tips, {better.method} on this model {better.again:.3g} m"
            )
    if without_model:
        print_message(f"no model to plan with: {without_model}", "red")
    print_message(f"written {folder / MODEL} and {link(page)}")


def _require_none(runs: list[Path], given: dict[str, object]) -> None:
    """Require of frequency responses and modes one file, and no option of a record in time."""
    if len(runs) > 1:
        raise BadInput("one universal file at a time", runs[1])
    for name, value in given.items():
        if value:
            raise BadInput(f"{name} needs a record in time; name its --inputs and --outputs, or "
                           f"leave out {name}", runs[0])  # fmt: skip


def _identify_universal(
    path: Path,
    band: tuple[float, float] | None,
    also: OutputOptions,
    out: Path | None,
    as_json: bool,
) -> None:
    """Fit the frequency responses of a universal file, or write its modes as modal data."""
    from flexslew_lab.identification.model_file import write_model
    from flexslew_lab.identification.responses.frf_fit import identify_responses
    from flexslew_lab.identification.responses.response_page import (
        response_numbers,
        response_rows,
        responses_page,
        responses_verdict,
    )
    from flexslew_lab.identification.responses.universal import (
        read_modal_data,
        read_responses,
        write_response_model,
    )
    from flexslew_lab.report.page import write_page
    from flexslew_plant.yaml_data import yaml_text

    folder, mass, uff = out or _output_folder(path), also.mass, also.uff
    if mass is not None:
        if band is not None or uff is not None or as_json:
            raise BadInput(
                "--band, --uff and --json are of frequency responses, not of modes", path
            )
        check_output_file(folder / APPENDAGE, "--out")
        write_model(folder / APPENDAGE, yaml_text(read_modal_data(path, mass)))
        print_message(f"written {folder / APPENDAGE}")
        return
    for name in (MODEL, PAGE):
        check_output_file(folder / name, "--out")
    if uff is not None:
        check_output_file(uff, "--uff")
    found = identify_responses(read_responses(path), band)
    write_model(folder / MODEL, yaml_text(response_numbers(found)))
    page = write_page(responses_page(found), folder / PAGE)
    if uff is not None:
        write_response_model(uff, found)
    if as_json:
        print(json_text(response_numbers(found)))
    else:
        print_table(("", path.name), response_rows(found))
        print_message(responses_verdict(found), "bold")
    print_message(f"written {folder / MODEL} and {link(page)}")


def _next(
    run: Path, experiment: "Experiment", model: "ModalModel", trust: list[str] | None
) -> "NextPlan":
    from flexslew_lab.identification.next_plan import next_plan
    from flexslew_lab.log.bag_reader import BagReader

    if experiment.flown is None or experiment.plan is not None:
        raise BadInput(f"{run}: --replan needs the log of a slew with its plan")
    with for_people.status("planning again"):
        return next_plan(
            BagReader(bag_folder(run), trust=Trust.of(trust or ())), model, experiment.flown
        )


def _experiment(run: Path, columns: RecordOptions, trust: list[str] | None) -> "Experiment":
    from flexslew_lab.identification.files import READERS
    from flexslew_lab.identification.identification import experiment_of
    from flexslew_lab.identification.records.file_experiment import FileColumns, experiment_of_file

    inputs, outputs, period = columns.inputs, columns.outputs, columns.period
    if not os.path.exists(run):
        raise BadInput("no such run", run)
    if columns.are_unnamed:
        if run.is_file() and run.suffix.lower() in READERS:
            raise BadInput("name its columns: --inputs and --outputs", run)
        return experiment_of(run, Trust.of(trust or ()))
    if not inputs or not outputs:
        raise BadInput(f"{run}: --inputs and --outputs belong together")
    if period is not None and not 0.0 < period < inf:
        raise BadInput("a number of seconds above 0", key="--period", value=period)
    names = {"inputs": _names(inputs), "outputs": _names(outputs)}
    chosen = FileColumns(**asdict(columns) | names)
    experiment, notes = experiment_of_file(bag_folder(run), chosen)
    for words in notes:
        print_message(f"{run}: {words}")
    return experiment


def _require_known(columns: RecordOptions) -> None:
    """Require of the options with a choice one of their values."""
    from flexslew_lab.identification.files.columns import UNITS
    from flexslew_lab.identification.records.hold import Hold

    if columns.hold not in (None, *get_args(Hold)):
        raise BadInput(f"one of {', '.join(get_args(Hold))}", key="--hold", value=columns.hold)
    if columns.time_unit not in (None, *UNITS):
        raise BadInput(f"one of {', '.join(UNITS)}", key="--time-unit", value=columns.time_unit)
    if columns.stamps not in _STAMPS:
        raise BadInput(f"one of {', '.join(_STAMPS)}", key="--stamps", value=columns.stamps)


def _names(text: str) -> tuple[str, ...]:
    from flexslew_lab.identification.files.csv_file import column_names

    return column_names(text)


def _output_folder(run: Path) -> Path:
    """Return the folder of a run of this bench; for anything else a new one."""
    if run.is_dir() and (run / "bag").is_dir():
        return run
    return new_folder("identification", None)


def _band(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    ends = numbers_in(text, ("rad/s",), "--band")
    if len(ends) != 2 or not 0.0 < ends[0] < ends[1]:
        raise BadInput("two numbers, low,high [rad/s]", key="--band", value=text)
    return ends[0], ends[1]


def _axes(text: str) -> dict[str, str]:
    pairs = [part.partition("=") for part in _names(text)]
    return {name.strip(): axis.strip() for name, _, axis in pairs}


def _starts(assignments: list[str] | None) -> dict[str, float]:
    found = {}
    for assignment in assignments or []:
        key, sign, value = assignment.partition("=")
        try:
            found[key.strip().removeprefix("testbed.")] = float(value)
        except ValueError:
            sign = ""
        if not sign:
            raise BadInput("key=value with a number", key="--start", value=assignment)
    return found
