"""Print every text that a user meets, in one list: `python docs/texts.py [--help-pages]`.

Errors, warnings, events, labels and titles are the literals of the source that have a blank in
them, docstrings left out, with `{...}` for values. With --help-pages, the help of every command
stands before them.
"""

import argparse
import ast
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "ros2_ws" / "src"


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of each literal of a file which a person may read."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inner = {id(part) for node in ast.walk(tree) for part in _parts(node)}
    for node in ast.walk(tree):
        if id(node) in inner:
            continue
        text = _text(node)
        if " " in text.strip() and any(map(str.isalpha, text)):
            yield node.lineno, " ".join(text.split())  # type: ignore[attr-defined]


def _parts(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what of a node is no text of its own: a docstring, the pieces of an f-string."""
    match node:
        case ast.Expr(value=ast.Constant(value=str())):
            yield node.value
        case ast.JoinedStr():
            for value in node.values:
                if isinstance(value, ast.FormattedValue):
                    yield from ast.walk(value.format_spec) if value.format_spec else ()
                else:
                    yield value


def _text(node: ast.AST) -> str:
    """Return the text of a literal, empty for other nodes."""
    match node:
        case ast.Constant(value=str(text)):
            return text
        case ast.JoinedStr(values=values):
            return "".join(_text(value) or "{...}" for value in values)
    return ""


def help_pages() -> Iterator[str]:
    """Yield the help of the program and of each of its commands."""
    from typer.main import get_command
    from typer.testing import CliRunner

    from flexslew_lab.cli.main import app

    def below(command: object, words: list[str]) -> Iterator[str]:
        yield f"$ flexslew {' '.join([*words, '--help'])}\n"
        yield CliRunner().invoke(app, [*words, "--help"]).output
        for name, child in getattr(command, "commands", {}).items():
            yield from below(child, [*words, name])

    yield from below(get_command(app), [])


def main() -> None:
    """Print help pages, if requested, and the texts of each file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--help-pages", action="store_true", help="with the help of every command")
    if parser.parse_args().help_pages:
        print("\n".join(help_pages()))
    for path in sorted(SOURCE.rglob("*.py")):
        found = sorted(texts(path))
        if found:
            print(f"\n{path.relative_to(SOURCE)}")
        for line, text in found:
            print(f"{line:5d}  {text}")


if __name__ == "__main__":
    main()
