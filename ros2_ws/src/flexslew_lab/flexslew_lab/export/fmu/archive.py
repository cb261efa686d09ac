"""C code as an FMU: a zip archive of a description, libraries and sources, the same every time.

FMI 2.0 and 3.0. Co-simulation: one tick is a communication step, and so is any multiple of it.
Model exchange: the equations of motion of a plant.
"""

import hashlib
import io
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import UUID
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from flexslew_lab.export.c_module import CModule
from flexslew_lab.export.fmu.binaries import TARGETS, Target, compile_library, require_compiler
from flexslew_lab.export.fmu.description import Version, build_description, description
from flexslew_lab.export.fmu.variables import (
    FmuVariable,
    SignalParts,
    is_timed,
    size_of,
    start_of,
    variables_of,
)

_EARLIEST = (1980, 1, 1, 0, 0, 0)  # that a zip archive can state
_RIGHTS = 0o644 << 16


def fmu_of(
    module: CModule,
    version: Version = 3,
    targets: tuple[Target, ...] = ("linux64",),
    elements: SignalParts | None = None,
) -> bytes:
    """Return a module as an FMU.

    Args:
        module: the C code and its signals.
        version: of FMI.
        targets: the systems for which it contains libraries.
        elements: names and units of the numbers of a signal; None: they are numbered.

    Raises:
        BadInput: a compiler is missing or refuses the code, or a unit is unknown.
    """
    require_compiler(targets)
    wrapper = f"fmi{version}.c"
    given = files(__package__) / "c"
    texts = {
        name: (given / name).read_text() for name in (wrapper, "both_versions.h", "instance.h")
    }
    texts |= module.sources
    compiled = [name for name in texts if name.endswith(".c")]
    variables = variables_of(module, elements or {})
    described = description(module, variables, version, "", compiled)
    token = _token(described, *(text.encode() for text in texts.values()))
    texts["model.h"] = _model_header(module, variables, token)
    content = {"modelDescription.xml": description(module, variables, version, token, compiled)}
    content |= {f"sources/{name}": text.encode() for name, text in texts.items()}
    if version == 3:
        content["sources/buildDescription.xml"] = build_description(module, compiled)
    with TemporaryDirectory() as name:
        folder = Path(name)
        for file, text in texts.items():
            (folder / file).write_text(text)
        for target in targets:
            place, suffix = TARGETS[target]
            library = compile_library(folder, compiled, module.name + suffix, target)
            place = target if version == 2 else place
            content[f"binaries/{place}/{module.name}{suffix}"] = library
    return _zipped(content)


def _token(*parts: bytes) -> str:
    """Return a token that only an FMU of the same content has."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(hashlib.sha256(part).digest())
    return f"{{{UUID(bytes=digest.digest()[:16])}}}"


def _model_header(module: CModule, variables: tuple[FmuVariable, ...], token: str) -> str:
    """Return model.h, which instance.h includes."""
    name = module.name
    inputs, outputs = size_of(module.inputs), size_of(module.outputs)
    places = ", ".join(str(place) for place in (0, *(v.place for v in variables)))
    numbers = [x for signal in (*module.inputs, *module.outputs) for x in start_of(signal)]
    start = ", ".join(repr(x) for x in numbers)
    header = next(file for file in module.sources if file.endswith(".h"))
    functions, states, parameters = "", 0, size_of(module.parameters)
    if parameters:
        functions = f"""\
#define MODEL_PARAMETERS_OF {name}_parameters
#define MODEL_SET_PARAMETERS {name}_set_parameters
#define MODEL_TUNABLE {int(module.tunable)}
"""
    if module.continuous is not None:
        states = len(module.continuous.states)
        functions += f"""\
#define MODEL_STATE {module.continuous.member} /* member of the memory */
#define MODEL_DERIVATIVES {name}_derivatives
#define MODEL_OUTPUTS_AT {name}_outputs
#define MODEL_MEASURE {name}_measure
"""
        if module.continuous.directional:
            functions += f"""\
#define MODEL_DERIVATIVES_ALONG {name}_derivatives_along
#define MODEL_OUTPUTS_ALONG {name}_outputs_along
"""
    return f"""\
/* What instance.h reads of the model; generated. */
#include "{header}"

#define MODEL_MEMORY {name}_memory
#define MODEL_INPUT {name}_{module.structs[0]}
#define MODEL_OUTPUT {name}_{module.structs[1]}
#define MODEL_INIT {name}_init
#define MODEL_STEP {name}_step
#define MODEL_INPUTS {inputs}
#define MODEL_OUTPUTS {outputs}
#define MODEL_PARAMETERS {parameters}
#define MODEL_STATES {states} /* continuous ones; 0: the model has ticks alone */
{functions}\
#define MODEL_VARIABLES {len(variables) + 1}
#define MODEL_TIMED {int(is_timed(module))}
#define MODEL_PERIOD {float(module.period)!r} /* [s] */
#define MODEL_PERIOD_TEXT "{module.period:g}"
#define MODEL_TOKEN "{token}"

static const size_t model_places[MODEL_VARIABLES] = {{{places}}};
static const double model_start[MODEL_INPUTS + MODEL_OUTPUTS] = {{{start}}};
"""


def _zipped(content: dict[str, bytes]) -> bytes:
    """Return a zip archive that depends on its content alone."""
    stream = io.BytesIO()
    with ZipFile(stream, "w", ZIP_DEFLATED) as archive:
        for name, data in sorted(content.items()):
            info = ZipInfo(name, _EARLIEST)
            info.compress_type, info.external_attr, info.create_system = ZIP_DEFLATED, _RIGHTS, 3
            archive.writestr(info, data)
    return stream.getvalue()
