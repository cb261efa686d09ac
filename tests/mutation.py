"""How many faults in the source do the tests find: `python -m tests.mutation --help`.

A mutant is the source with one sign, index, bound or unit changed. The places are drawn by a seed.
For each mutant the default tests run until one fails: those of its module, of its folder, of its
package, and at last all. The file is restored after each mutant.
"""

import argparse
import ast
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

from flexslew_lab.cli.suite import NO_TESTS_EXIT_CODE, OPTIONAL_MARKERS, OVER_ROS, Selection

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "ros2_ws" / "src"
PACKAGES = ("flexslew_plant", "flexslew_control", "flexslew_lab")
STAGES = ("module", "folder", "package", "all")
TIMEOUT = 3600.0  # of a stage [s]; a mutant that takes longer is found
STRICT = {ast.Lt: ("<", "<="), ast.LtE: ("<=", "<"), ast.Gt: (">", ">="), ast.GtE: (">=", ">")}
EXTREMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
# functions that inline one of these are not compiled again when its file changes
KERNEL = re.compile(r"@(compiled|called|inlined|merged|overload|vectorised)|from numba")
_TERM = (ast.Mult, ast.Div, ast.Pow)


class Mutant(NamedTuple):
    """A change of a file."""

    kind: str
    path: Path
    line: int
    start: int  # first character that is replaced
    end: int
    text: str  # that takes its place

    def source(self) -> str:
        """Return the changed text of the file."""
        whole = self.path.read_text(encoding="utf-8")
        return whole[: self.start] + self.text + whole[self.end :]

    def __str__(self) -> str:
        before = self.path.read_text(encoding="utf-8").splitlines()[self.line - 1].strip()
        after = self.source().splitlines()[self.line - 1].strip()
        return f"{self.kind} {self.path.relative_to(SOURCE)}:{self.line}\n    {before}\n    {after}"


class Sites:
    """The places of a file in which one character or word can be wrong."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = path.read_text(encoding="utf-8")
        self._lines = [0]
        for line in self.text.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))

    def mutants(self) -> Iterator[Mutant]:
        """Yield every mutant of the file."""
        for node in _without_annotations(ast.parse(self.text)):
            match node:
                case ast.BinOp(op=ast.Sub() | ast.Add()):
                    yield from self._sign(node)
                case ast.UnaryOp(op=ast.USub(), operand=operand):
                    start = self._at(node.lineno, node.col_offset)
                    yield self._mutant("sign", node, start, self._start(operand), "")
                case ast.Compare(ops=[op], left=left, comparators=[right]) if type(op) in STRICT:
                    yield from self._operator("bound", node, left, right, *STRICT[type(op)])
                case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)):
                    if name in EXTREMES:
                        end = self._end(node.func)
                        yield self._mutant("bound", node, end - len(name), end, EXTREMES[name])
                case ast.Subscript(slice=ast.Constant(value=int(index))):
                    yield self._number("index", node.slice, index + 1)
                case ast.Slice():
                    for edge in (node.lower, node.upper):
                        if isinstance(edge, ast.Constant) and isinstance(edge.value, int):
                            yield self._number("index", edge, edge.value + 1)
                case ast.BinOp(op=ast.Mult() | ast.Div()):
                    for side in (node.left, node.right):
                        if isinstance(side, ast.Constant) and isinstance(side.value, float):
                            yield self._number("unit", side, 1e3 * side.value)

    def _sign(self, node: ast.BinOp) -> Iterator[Mutant]:
        """Yield a mutant if the operands are numbers for sure: a difference, or a sum of terms."""
        sides = (node.left, node.right)
        number = any(
            (isinstance(side, ast.BinOp) and isinstance(side.op, _TERM))
            or (isinstance(side, ast.Constant) and isinstance(side.value, int | float))
            for side in sides
        )
        if isinstance(node.op, ast.Sub):
            yield from self._operator("sign", node, *sides, "-", "+")
        elif number:
            yield from self._operator("sign", node, *sides, "+", "-")

    def _operator(
        self, kind: str, node: ast.expr, left: ast.expr, right: ast.expr, old: str, new: str
    ) -> Iterator[Mutant]:
        """Yield a mutant with another operator between two operands."""
        first, last = self._end(left), self._start(right)
        at = self.text.find(old, first, last)
        if at >= 0 and "#" not in self.text[first:last]:
            yield self._mutant(kind, node, at, at + len(old), new)

    def _number(self, kind: str, node: ast.expr, value: float) -> Mutant:
        return self._mutant(kind, node, self._start(node), self._end(node), repr(value))

    def _mutant(self, kind: str, node: ast.expr, start: int, end: int, text: str) -> Mutant:
        line = self.text.count("\n", 0, start) + 1
        return Mutant(kind, self.path, line, start, end, text)

    def _start(self, node: ast.expr) -> int:
        return self._at(node.lineno, node.col_offset)

    def _end(self, node: ast.expr) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._at(node.end_lineno, node.end_col_offset)

    def _at(self, line: int, column: int) -> int:
        """Return the index of a character; the parser counts columns in bytes."""
        start = self._lines[line - 1]
        row = self.text[start : self._lines[line]].encode()
        return start + len(row[:column].decode())


def _without_annotations(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a tree, but for those of types."""
    yield tree
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _without_annotations(child)


def drawn(seed: int, count: int, only: str) -> list[Mutant]:
    """Return mutants of all kinds in turn, at random places of the modules that match."""
    random, by_kind = Random(seed), dict[str, list[Mutant]]()
    for package in PACKAGES:
        for path in sorted((SOURCE / package / package).rglob("*.py")):
            if "ros" not in path.parts and re.search(only, path.as_posix()):
                for mutant in Sites(path).mutants():
                    by_kind.setdefault(mutant.kind, []).append(mutant)
    for mutants in by_kind.values():
        random.shuffle(mutants)
    turns = range(max(map(len, by_kind.values()), default=0))
    ordered = [m[k] for k in turns for _, m in sorted(by_kind.items()) if k < len(m)]
    return ordered[:count]


def stages(mutant: Mutant) -> list[list[str]]:
    """Return the paths of the tests that mirror a module, its folder and its package, and all."""
    inside = mutant.path.relative_to(SOURCE).parts[1:]
    package = ROOT / "tests" / inside[0].removeprefix("flexslew_")
    folder = package.joinpath(*inside[1:-1])
    while not folder.is_dir():
        folder = folder.parent
    module = sorted(folder.rglob(f"test_*{mutant.path.stem}*.py"))
    plain = ["tests", *(f"--ignore={part}" for part in OVER_ROS)]
    return [[*map(str, module)], [str(folder)], [str(package)], plain]


def found(paths: list[str], expression: str, environment: dict[str, str]) -> bool:
    """Return True if a test of the paths fails."""
    command = [sys.executable, "-P", "-m", "pytest", "-x", "-p", "no:cacheprovider", "-m"]
    command += [expression, *paths]
    try:
        done = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, timeout=TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return True
    return done.returncode not in (0, NO_TESTS_EXIT_CODE)


def stage_of(mutant: Mutant, widest: str, expression: str) -> str:
    """Return the stage at which a mutant is found; nothing if it is not."""
    original, times = mutant.path.read_text(encoding="utf-8"), mutant.path.stat()
    with tempfile.TemporaryDirectory() as folder:
        cache = {"NUMBA_CACHE_DIR": folder} if KERNEL.search(original) else {}
        mutant.path.write_text(mutant.source(), encoding="utf-8")
        try:
            for name, paths in zip(
                STAGES[: STAGES.index(widest) + 1], stages(mutant), strict=False
            ):
                if paths and found(paths, expression, os.environ | cache):
                    return name
        finally:
            mutant.path.write_text(original, encoding="utf-8")
            os.utime(mutant.path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return ""


def main() -> None:
    """Run the tests on mutants and print what finds each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the places")
    parser.add_argument("--count", type=int, default=30, help="of mutants")
    parser.add_argument("--only", default="", help="modules that match this regular expression")
    parser.add_argument("--widest", choices=STAGES, default="all", help="the last stage")
    parser.add_argument("--list", action="store_true", help="print the mutants alone")
    asked = parser.parse_args()
    default, beyond = Selection().expression(all_tests=False), " or ".join(OPTIONAL_MARKERS)
    results = []
    for number, mutant in enumerate(drawn(asked.seed, asked.count, asked.only), start=1):
        print(f"{number}: {mutant}", flush=True)
        if not asked.list:
            stage = stage_of(mutant, asked.widest, default)
            if not stage and stage_of(mutant, asked.widest, beyond):
                stage = "marked tests alone"
            results.append(stage or "not found")
            print(f"    {results[-1]}", flush=True)
    for stage in dict.fromkeys(results):
        print(f"{results.count(stage)} of {len(results)}: {stage}")


if __name__ == "__main__":
    main()
