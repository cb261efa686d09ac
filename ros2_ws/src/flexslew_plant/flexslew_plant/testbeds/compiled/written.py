"""A tape as text for the compiler: loops over members without a branch, which it vectorises."""

from collections.abc import Container, Mapping, Sequence
from typing import Any, NamedTuple

from flexslew_plant.testbeds.compiled.tape import Number, Tape, Value

_FORM = {
    "arctan2": "np.arctan2({}, {})",
    "sqrt": "{} ** 0.5",
    "abs": "abs({})",
    "where": "({1} if {0} else {2})",
}
_SINE_COSINE = ("sine", "cosine")


class Needed(NamedTuple):
    """What results need of a tape, by places on it in their order."""

    steps: list[int]  # computed every time
    constants: list[int]  # known before the first


class BlockLayout(NamedTuple):
    """Where in w what a function reads begins, and how it is called."""

    rows: Mapping[str, int]  # of the inputs "x" and "u", and of the constants
    constants: Sequence[int]  # places on the tape, in the order of their rows
    width: int  # members of a block, next to each other in w
    given: str = "t, h, w"  # its arguments


def needed(tape: Tape, results: Sequence[Value], known: Container[int] = ()) -> Needed:
    """Return what these results need, beyond what is known already."""
    steps: set[int] = set()
    constants: set[int] = set()
    waiting = [value.index for value in results if isinstance(value, Number)]
    while waiting:
        k = waiting.pop()
        if tape.parametric[k]:
            constants.add(k)
        elif k not in steps and k not in known:
            steps.add(k)
            name, *parts = tape.nodes[k]
            waiting += [part for part in parts if type(part) is int and name != "input"]
    return Needed(sorted(steps), sorted(constants))


def sine_numbers_of(tape: Tape, results: Sequence[Value]) -> list[Number]:
    """Return the sines and cosines that results need, which take long to find again."""
    found = needed(tape, results).steps
    return [Number(tape, k) for k in found if tape.nodes[k][0] in _SINE_COSINE]


def written(
    name: str, tape: Tape, loops: Sequence[Mapping[int, Value]], layout: BlockLayout
) -> str:
    """Return the text of a function that writes results for all members of a block.

    Each pass is a loop over the members. What one has written the later ones read, so none but the
    last may write over an input.

    Args:
        name: of the function.
        tape: the operations.
        loops: results by where in w they begin.
        layout: of what it reads.
    """
    lines = [f"def {name}({layout.given}):", "    aligned_frame()"]
    first, width = layout.rows["constants"], layout.width
    places = {k: first + i * width for i, k in enumerate(layout.constants)}
    for results in loops:
        lines += _loop(tape, results, places, layout)
        for row, value in results.items():
            if isinstance(value, Number):
                places.setdefault(value.index, row)
    return "\n".join(lines) + "\n"


def _loop(
    tape: Tape, results: Mapping[int, Value], places: Mapping[int, int], layout: BlockLayout
) -> list[str]:
    """Return the lines of a pass; places: where in w stands what is known already, by node."""

    def text(part: Any) -> str:
        if isinstance(part, tuple):
            return repr(part[1])
        return f"w[{places[part]} + k]" if part in places else f"a{part}"

    rows, width, lines = layout.rows, layout.width, [f"    for k in range({layout.width}):"]
    known_angles: dict[tuple[object, ...], int] = {}  # what sine and cosine are there of
    for k in needed(tape, list(results.values()), places).steps:
        what, *parts = tape.nodes[k]
        if what == "input":
            kind, index = parts
            shared = kind in ("t", "h")
            value = kind if shared else f"w[{rows[kind] + index * width} + k]"
        elif what in _SINE_COSINE:
            angle = tuple(parts)
            if angle not in known_angles:
                known_angles[angle] = k
                function = "turned" if len(parts) > 1 else "sine_cosine"
                lines.append(f"        s{k}, c{k} = {function}({', '.join(map(text, parts))})")
            value = f"{what[0]}{known_angles[angle]}"
        elif what in _FORM:
            value = _FORM[what].format(*map(text, parts))
        else:
            value = f"{text(parts[0])} {what} {text(parts[1])}"
        lines.append(f"        a{k} = {value}")
    for row, result in results.items():
        value = text(result.index) if isinstance(result, Number) else repr(float(result))
        lines.append(f"        w[{row} + k] = {value}")
    return lines
