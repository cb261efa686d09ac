"""The text of a C module: its header and its source."""

import re
from collections.abc import Sequence
from typing import NamedTuple

from flexslew_lab.export.c_code.operations import TYPES
from flexslew_lab.export.c_code.phases import MemoryMember, Phases
from flexslew_lab.export.c_code.program import Block, Node, literal, live_names, printed

_NUMBER = re.compile(r"(?<![\w.])(\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)(?![\w.])")
_FUNCTION = re.compile(
    r"\b(sqrt|sin|cos|tan|atan2|exp|log|log2|asin|acos|atan|tanh|copysign|hypot|pow|fabs|floor|ceil|rint|expm1)"
    r"\("
)
_PER_LINE = 6  # numbers of a table


class Signal(NamedTuple):
    """A member of a struct of the module."""

    name: str
    unit: str
    size: int
    start: tuple[float, ...]
    labels: tuple[str, ...] = ()  # names of its numbers; (): they are numbered


class Interface(NamedTuple):
    """Names and structs of a module."""

    name: str  # prefix of all names
    about: str  # what it is, one line
    inputs: tuple[str, tuple[Signal, ...]]  # name of the struct, and members
    outputs: tuple[str, tuple[Signal, ...]]
    period: float  # [s]
    single: bool  # float in place of double
    parameters: tuple[Signal, ...] = ()  # members of a struct in the memory


class Function(NamedTuple):
    """A further function of a module, which only reads the memory."""

    name: str  # behind that of the module
    about: str
    arguments: tuple[str, ...]  # their declarations; NAME for the module, REAL for its numbers
    block: Block
    outputs: tuple[str, ...]  # names of what it writes

    def signature(self, module: str, real: str) -> str:
        """Return its declaration without the semicolon."""
        given = ", ".join(("const NAME_memory *memory", *self.arguments))
        given = given.replace("NAME", module).replace("REAL", real)
        return f"void {module}_{self.name}({given})"

    @property
    def inputs(self) -> list[str]:
        """The names of its arguments."""
        return ["memory", *(one.split()[-1].lstrip("*") for one in self.arguments)]


def sources(
    what: Interface,
    phases: Phases,
    functions: Sequence[Function] = (),
    derived: Sequence[Node] = (),
) -> dict[str, str]:
    """Return the header and the source of a module, by file name.

    Args:
        what: names and structs.
        phases: the step.
        functions: further ones.
        derived: statements that write what of the memory depends on the parameters.
    """
    outputs = {f"output->{one.name}" for one in what.outputs[1]}
    blocks = [*phases.blocks, list(derived), *(one.block for one in functions)]
    live = live_names(blocks, outputs | {name for one in functions for name in one.outputs})
    members = [one for one in phases.members.values() if f"memory->{one.name}" in live and one]
    members = [one for one in members if 0 not in one.shape]
    return {
        f"{what.name}.h": _header(what, members, functions),
        f"{what.name}.c": _source(what, phases, live, functions, derived),
    }


def _header(what: Interface, members: Sequence[MemoryMember], functions: Sequence[Function]) -> str:
    guard, real = f"{what.name.upper()}_H", "float" if what.single else "double"
    lines = [f"/* {what.about} */", f"#ifndef {guard}", f"#define {guard}", ""]
    parameters = ("parameters", what.parameters)
    for name, signals in filter(lambda one: one[1], (what.inputs, what.outputs, parameters)):
        lines.append("typedef struct {")
        lines += [
            f"    {real} {s.name}{f'[{s.size}]' if s.name != 'time' else ''};"
            f"{f' /* [{s.unit}] */' if s.unit else ''}"
            for s in signals
        ]
        lines += [f"}} {what.name}_{name};", ""]
    lines += [
        "/* what is kept from tick to tick */",
        "typedef struct {",
        *([f"    {what.name}_parameters parameters;"] if what.parameters else []),
        "    int phase;",
        "    int tick;",
    ]
    for one in members:
        size = 1
        for part in one.shape:
            size *= part
        kind = real if TYPES[one.kind] == "real" else "int"
        lines.append(f"    {kind} {one.name}{f'[{size}]' if one.shape else ''};")
    (given, _), (result, _) = what.inputs, what.outputs
    declared = []
    if what.parameters:
        declared = [
            f"/* Replace the parameters, which {what.name}_init sets to those of the trial. */",
            f"void {_set_parameters(what.name)};",
        ]
    further = [
        line
        for one in functions
        for line in (f"/* {one.about} */", f"{one.signature(what.name, real)};")
    ]
    return "\n".join(
        [
            *lines,
            f"}} {what.name}_memory;",
            "",
            f"/* Begin before the first tick; a tick takes {literal(what.period)} s. */",
            f"void {what.name}_init({what.name}_memory *memory);",
            "/* Carry out one tick. */",
            f"void {what.name}_step({what.name}_memory *memory, const {what.name}_{given} *input,",
            f"                       {what.name}_{result} *output);",
            *declared,
            *further,
            "",
            "#endif",
            "",
        ]
    )


def _set_parameters(name: str) -> str:
    """Return the declaration of the function that replaces the parameters."""
    return f"{name}_set_parameters({name}_memory *memory, const {name}_parameters *parameters)"


def _default_parameters(what: Interface) -> list[str]:
    """Return the statements that set the parameters to those of the trial."""
    if not what.parameters:
        return []
    rows = (", ".join(map(literal, one.start)) for one in what.parameters)
    values = ", ".join(f"{{{row}}}" for row in rows)
    return [
        f"    static const {what.name}_parameters defaults = {{{values}}};",
        "    memory->parameters = defaults;",
    ]


def _source(
    what: Interface,
    phases: Phases,
    live: set[str],
    functions: Sequence[Function],
    derived: Sequence[Node],
) -> str:
    (given, _), (result, _) = what.inputs, what.outputs
    memory = f"{what.name}_memory *memory"
    arguments = f"{memory}, const {what.name}_{given} *input, {what.name}_{result} *output"
    lines = list[str]()
    for number, block in enumerate(phases.blocks):
        lines += [f"static void phase_{number}({arguments})", "{"]
        lines += ["    (void)memory;", "    (void)input;", "    (void)output;"]
        lines += [*printed(block, live), "}", ""]
    last = len(phases.blocks) - 1
    lines += [
        f"void {what.name}_init({what.name}_memory *memory)", "{",
        f"    static const {what.name}_memory empty = {{0}};", "    *memory = empty;",
        *_default_parameters(what), *printed(phases.starts, live), "}", "",
        f"void {what.name}_step({arguments})", "{",
        "    if (memory->phase == 0) {",
        f"        memory->tick = (int)floor(input->time / {literal(what.period)} + 0.5);", "    }",
        "    switch (memory->phase) {",
    ]  # fmt: skip
    for number in range(last):
        lines += [
            f"    case {number}:",
            f"        phase_{number}(memory, input, output);",
            "        break;",
        ]
    lines += [
        "    default:",
        f"        phase_{last}(memory, input, output);",
        "        break;",
        "    }",
    ]
    most = max(last, 1)
    lines += [f"    if (memory->phase < {most}) {{", "        memory->phase++;", "    }"]
    lines += ["    memory->tick++;", "}", ""]
    for one in functions:
        unused = [f"    (void){name};" for name in one.inputs]
        lines += [
            one.signature(what.name, "real"),
            "{",
            *unused,
            *printed(one.block, live),
            "}",
            "",
        ]
    if what.parameters:
        lines += [f"void {_set_parameters(what.name)}", "{"]
        lines += ["    memory->parameters = *parameters;", *printed(list(derived), live), "}", ""]
    body = "\n".join(lines)
    used = set(re.findall(r"\btable_\d+\b", body))
    tables = list[str]()
    for name, values in phases.evaluator.ops.constants.arrays.items():
        if name not in used:
            continue
        kind = "real" if values.dtype.kind == "f" else "int"
        numbers = [literal(one) for one in values.ravel().tolist()] or ["0"]  # never read
        rows = [", ".join(numbers[k : k + _PER_LINE]) for k in range(0, len(numbers), _PER_LINE)]
        tables += [f"static const {kind} {name}[{len(numbers)}] = {{"]
        tables += [f"    {row}," for row in rows] + ["};", ""]
    text = "\n".join([*tables, body])
    if what.single:
        text = _FUNCTION.sub(r"\1f(", _NUMBER.sub(r"\1f", text))
    head = (
        f'/* {what.about} */\n#include <math.h>\n\n#include "{what.name}.h"\n\n'
        f"typedef {'float' if what.single else 'double'} real;\n\n"
    )
    return head + text
