"""A tape as text for the compiler: a loop over lanes without a branch, which it vectorises."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from flexslew_plant.testbeds.compiled.tape import Number, Tape, Value

_FORM = {
    "arctan2": "np.arctan2({}, {})",
    "sqrt": "{} ** 0.5",
    "abs": "abs({})",
    "where": "({1} if {0} else {2})",
}


class Needed(NamedTuple):
    """What results need of a tape, by places on it in their order."""

    steps: list[int]  # computed every time
    constants: list[int]  # known before the first


def needed(tape: Tape, results: Sequence[Value]) -> Needed:
    """Return what these results need."""
    steps: set[int] = set()
    constants: set[int] = set()
    waiting = [value.index for value in results if isinstance(value, Number)]
    while waiting:
        k = waiting.pop()
        if tape.parametric[k]:
            constants.add(k)
        elif k not in steps:
            steps.add(k)
            name, *parts = tape.nodes[k]
            waiting += [part for part in parts if type(part) is int and name != "input"]
    return Needed(sorted(steps), sorted(constants))


def written(
    name: str,
    tape: Tape,
    needs: Needed,
    rows: Mapping[str, int],
    results: Mapping[int, Value],
    width: int,
    given: str = "t, h, w",
) -> str:
    """Return the text of a function of `given` that writes results for all lanes of a block.

    Args:
        name: of the function.
        tape: the operations.
        needs: of the results.
        rows: where in w the inputs "x" and "u" and the "constants" of needs begin.
        results: by where in w they begin.
        width: lanes of a block, which stand beside each other in w.
        given: its arguments.
    """
    of_constant = {k: rows["constants"] + i * width for i, k in enumerate(needs.constants)}

    def text(part: object) -> str:
        if isinstance(part, tuple):
            return repr(part[1])
        return f"w[{of_constant[part]} + k]" if part in of_constant else f"a{part}"

    lines = [f"def {name}({given}):", "    aligned_frame()", f"    for k in range({width}):"]
    turned: dict[tuple[object, ...], int] = {}  # what sine and cosine are there of
    for k in needs.steps:
        what, *parts = tape.nodes[k]
        if what == "input":
            kind, index = parts
            shared = kind in ("t", "h")
            value = kind if shared else f"w[{rows[kind] + index * width} + k]"
        elif what in ("sine", "cosine"):
            angle = tuple(parts)
            if angle not in turned:
                turned[angle] = k
                function = "turned" if len(parts) > 1 else "sine_cosine"
                lines.append(f"        s{k}, c{k} = {function}({', '.join(map(text, parts))})")
            value = f"{what[0]}{turned[angle]}"
        elif what in _FORM:
            value = _FORM[what].format(*map(text, parts))
        else:
            value = f"{text(parts[0])} {what} {text(parts[1])}"
        lines.append(f"        a{k} = {value}")
    for row, result in results.items():
        value = text(result.index) if isinstance(result, Number) else repr(float(result))
        lines.append(f"        w[{row} + k] = {value}")
    return "\n".join(lines) + "\n"
