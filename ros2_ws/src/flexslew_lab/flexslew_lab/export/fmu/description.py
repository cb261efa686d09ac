"""modelDescription.xml of FMI 2.0 and 3.0."""

from typing import Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from flexslew_lab.export.c_module import CModule
from flexslew_lab.export.fmu.units import base_exponents
from flexslew_lab.export.fmu.variables import TIME, FmuVariable
from flexslew_plant.version import VERSION

Version = Literal[2, 3]


def description(
    module: CModule,
    variables: tuple[FmuVariable, ...],
    version: Version,
    token: str,
    sources: list[str],
) -> bytes:
    """Return the model description of a module.

    Args:
        module: its name and its period.
        variables: all but the time.
        version: of FMI.
        token: which the library compares with its own.
        sources: file names of its C code.

    Raises:
        BadInput: a signal has an unknown unit.
    """
    about = {
        "fmiVersion": f"{version}.0",
        "modelName": module.name,
        "generationTool": f"flexslew {VERSION}",
        "variableNamingConvention": "structured",
        "guid" if version == 2 else "instantiationToken": token,
    }
    if version == 2 and module.continuous is not None:
        about["numberOfEventIndicators"] = "0"
    root = Element("fmiModelDescription", about)
    _add_simulations(root, module, version, sources)
    _add_units(root, variables)
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(module.period))
    (_variables_2 if version == 2 else _variables_3)(root, variables)
    return _xml_text(root)


def _add_simulations(root: Element, module: CModule, version: Version, sources: list[str]) -> None:
    state = "State" if version == 3 else "state"  # as the versions spell it
    directional = module.continuous is not None and module.continuous.directional
    for kind in _interfaces(module):
        simulation = SubElement(root, kind, modelIdentifier=module.name)
        simulation.set(f"canGetAndSetFMU{state}", "true")
        simulation.set(f"canSerializeFMU{state}", "true")
        if version == 2:
            simulation.set("canNotUseMemoryManagementFunctions", "true")
        if kind == "ModelExchange" and directional:
            simulation.set(f"providesDirectionalDerivative{'s' * (version == 3)}", "true")
        if version == 3 and kind == "CoSimulation":
            simulation.set("canHandleVariableCommunicationStepSize", "true")
            simulation.set("fixedInternalStepSize", repr(module.period))
        if version == 2:
            files = SubElement(simulation, "SourceFiles")
            for name in sources:
                SubElement(files, "File", name=name)


def _interfaces(module: CModule) -> tuple[str, ...]:
    """Return the kinds of simulation that a module offers, in the order of the standard."""
    return ("CoSimulation",) if module.continuous is None else ("ModelExchange", "CoSimulation")


def build_description(module: CModule, sources: list[str]) -> bytes:
    """Return buildDescription.xml, which FMI 3.0 asks for beside the sources."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=module.name)
    files = SubElement(build, "SourceFileSet", language="C99")
    for name in sources:
        SubElement(files, "SourceFile", name=name)
    return _xml_text(root)


def _xml_text(root: Element) -> bytes:
    indent(root)
    text: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _add_units(root: Element, variables: tuple[FmuVariable, ...]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for unit in sorted({"s", *(variable.unit for variable in variables if variable.unit)}):
        exponents = {base: str(power) for base, power in base_exponents(unit).items()}
        SubElement(SubElement(definitions, "Unit", name=unit), "BaseUnit", exponents)


def _attributes(variable: FmuVariable, reference: int) -> dict[str, str]:
    """Return the attributes of a variable that both versions have."""
    found = {
        "name": variable.name,
        "valueReference": str(reference),
        "causality": variable.causality,
        "variability": variable.variability,
    }
    if variable.causality != "input":
        found["initial"] = "calculated" if variable.start is None else "exact"
    return found


def _number(variable: FmuVariable, first: int) -> dict[str, str]:
    """Return the attributes of a real number.

    Args:
        variable: the variable.
        first: by which a value reference is less than what stands for a state here.
    """
    found = {"unit": variable.unit} if variable.unit else {}
    if variable.start is not None:
        found["start"] = repr(float(variable.start))
    if variable.state is not None:
        found["derivative"] = str(variable.state + first)
    return found


_TIME = {
    "name": TIME,
    "valueReference": "0",
    "causality": "independent",
    "variability": "continuous",
}


def _variables_2(root: Element, variables: tuple[FmuVariable, ...]) -> None:
    table = SubElement(root, "ModelVariables")
    SubElement(SubElement(table, "ScalarVariable", _TIME), "Real", unit="s")
    for reference, variable in enumerate(variables, 1):
        entry = SubElement(table, "ScalarVariable", _attributes(variable, reference))
        SubElement(entry, "Real", _number(variable, 1))
    structure = SubElement(root, "ModelStructure")
    for kind, references in _unknowns(variables).items():
        names = {"Output": "Outputs", "ContinuousStateDerivative": "Derivatives"}
        if references:
            group = SubElement(structure, names.get(kind, "InitialUnknowns"))
            for reference in references:  # indices count from 1, the time's
                known = _dependencies(variables[reference - 1], kind, 1)
                SubElement(group, "Unknown", {"index": str(reference + 1), **known})


def _variables_3(root: Element, variables: tuple[FmuVariable, ...]) -> None:
    table = SubElement(root, "ModelVariables")
    SubElement(table, "Float64", {**_TIME, "unit": "s"})
    for reference, variable in enumerate(variables, 1):
        SubElement(table, "Float64", _attributes(variable, reference) | _number(variable, 0))
    structure = SubElement(root, "ModelStructure")
    for kind, references in _unknowns(variables).items():
        for reference in references:
            known = _dependencies(variables[reference - 1], kind, 0)
            SubElement(structure, kind, {"valueReference": str(reference), **known})


def _dependencies(variable: FmuVariable, kind: str, first: int) -> dict[str, str]:
    """Return the attribute of what an output depends on; none: on everything."""
    if variable.depends is None or kind != "Output":
        return {}
    return {"dependencies": " ".join(str(k + first) for k in variable.depends)}


def _unknowns(variables: tuple[FmuVariable, ...]) -> dict[str, list[int]]:
    """Return the value references of what is calculated, by its place in the structure."""
    each = list(enumerate(variables, 1))
    return {
        "Output": [k for k, one in each if one.causality == "output"],
        "ContinuousStateDerivative": [k for k, one in each if one.state is not None],
        "InitialUnknown": [k for k, one in each if one.start is None],
    }
