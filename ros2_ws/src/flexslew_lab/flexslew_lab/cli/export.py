"""Subcommand that writes what flies for other programs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from flexslew_lab.cli.options.option_groups import expand_options
from flexslew_lab.cli.options.shared import Sets, TrialFile
from flexslew_lab.cli.terminal import link, print_line, print_message, print_table
from flexslew_lab.progress import display_progress
from flexslew_lab.trial.outputs import check_output_file
from flexslew_plant.errors import BadInput


@dataclass(frozen=True)
class CodeOptions:
    """The C code: its precision and its checks."""

    single: Annotated[
        bool, typer.Option("--float", help="Numbers of single precision in the C code.")
    ] = False
    sizes: Annotated[
        bool, typer.Option("--sizes", help="Size on x86-64, aarch64 and Cortex-M7, by zig.")
    ] = False
    no_check: Annotated[
        bool, typer.Option("--no-check", help="Do not compile and run the code here.")
    ] = False


@dataclass(frozen=True)
class FmuOptions:
    """The functional mock-up unit."""

    fmu: Annotated[
        Path | None, typer.Option(help="An FMU of the controller, or of the testbed with --plant.")
    ] = None
    fmi: Annotated[int, typer.Option(help="Version of FMI, 2 or 3.")] = 3
    binaries: Annotated[
        str, typer.Option(help="Libraries in the FMU: linux64, or linux64,win64.")
    ] = "linux64"


@expand_options
def export(
    file: TrialFile = None,
    sets: Sets = None,
    c: Annotated[Path | None, typer.Option("--c", help="Folder of the C99 code.")] = None,
    controller: Annotated[
        str | None, typer.Option(help="Controller of the trial; default: the one in charge.")
    ] = None,
    plant: Annotated[
        bool,
        typer.Option("--plant", help="The testbed with its motors and sensors, too; as the FMU."),
    ] = False,
    *,
    code: CodeOptions,
    unit: FmuOptions,
) -> None:
    """Write the controller of a trial, with its plan, or its testbed as C code or as an FMU.

    Example: `./flexslew export m1 --c m1_c --fmu controller.fmu`
    """
    from flexslew_lab.export.c_module import module_of
    from flexslew_lab.export.compiled import compilers
    from flexslew_lab.export.flight_vector import controller_vector, plant_vector
    from flexslew_lab.export.fmu.binaries import targets_of
    from flexslew_lab.export.fmu.of_trial import fmu_of_trial
    from flexslew_lab.export.folder import check_folder, write_folder
    from flexslew_lab.export.plant_module import plant_module
    from flexslew_lab.export.targets import sizes_on_targets
    from flexslew_lab.trial.sources import read_trial
    from flexslew_lab.trial.trial import build_controllers, plan_of_trial

    fmu, single = unit.fmu, code.single
    if c is None and fmu is None:
        raise BadInput("give --c FOLDER, --fmu FILE.fmu, or both")
    if fmu is not None:
        require_fmu(fmu, unit.fmi, single, file)
    targets = targets_of(unit.binaries)
    if c is not None and c.exists() and not c.is_dir():
        raise BadInput(f"--c: {c} is a file; give a folder")
    requested, source = read_trial(file, sets)
    name = requested.active if controller is None else controller
    if name not in requested.controllers:
        known = ", ".join(requested.controllers)
        raise BadInput(f"no such controller; allowed: {known}", source, "--controller", name)
    with display_progress(requested.name, words="writing the code"):
        plan = plan_of_trial(requested, predict=False)
        built = build_controllers(requested, source)[name]
        modules = [module_of(requested, built, plan, single, source)]
        if plant:
            modules.append(plant_module(requested, single, source))
        if fmu is not None:
            fmu.parent.mkdir(parents=True, exist_ok=True)
            version: Literal[2, 3] = 2 if unit.fmi == 2 else 3
            fmu.write_bytes(fmu_of_trial(requested, modules[-1], version, targets))
            print_message(f"written {link(fmu)}")
        if c is None:
            return
        vectors = [controller_vector(requested, name, plan, source)]
        vectors += [plant_vector(requested, one, plan, source) for one in modules[1:]]
        files = write_folder(list(zip(modules, vectors, strict=True)), c, single)
    for path in files:
        print_message(f"written {link(path)}")
    if code.sizes:
        rows = [(m.name, *map(str, row)) for m in modules for row in sizes_on_targets(m, c)]
        print_table(("module", "processor", "code [B]", "RAM [B]", "stack [B]"), rows)
    if code.no_check:
        return
    if not compilers():
        print_message("not checked: no C compiler is here; install gcc or clang")
        return
    for module in modules:
        print_line(f"{module.name}: {check_folder(module, c)}")


def require_fmu(file: Path, fmi: int, single: bool, trial: Path | str | None) -> None:
    """Check the options of an FMU.

    Raises:
        BadInput: the file does not end in .fmu, or the version or the precision is not offered.
    """
    if file.suffix != ".fmu":
        raise BadInput("give a file that ends in .fmu", key="--fmu", value=str(file))
    check_output_file(file, "--fmu", trial)
    if fmi not in (2, 3):
        raise BadInput("2 and 3 are offered", key="--fmi", value=fmi)
    if single:
        raise BadInput("an FMU has numbers of double precision; leave it out", key="--float")
