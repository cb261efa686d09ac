"""The controller of docs/any_language.md; with `-p pushes:=true` it pushes whatever it sees."""

import sys
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "docs/examples/any_language.py"
_HOLDS = "-STIFFNESS * position - DAMPING * rate"


def main() -> None:
    words = EXAMPLE.read_text()
    assert _HOLDS in words
    if "pushes:=true" in sys.argv:
        words = words.replace(_HOLDS, "5.0 + 0.0 * position * rate")
    exec(compile(words, str(EXAMPLE), "exec"), {"__name__": "__main__"})
