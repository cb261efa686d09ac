"""What a file says is shown on a terminal, and obeyed by none."""

import ast
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.lab.conftest import Call

from flexslew_lab.cli import terminal
from flexslew_lab.cli.terminal import print_line, print_message, print_table
from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.progress import display_progress

TITLE, CLIPBOARD, RETURN = "\x1b]0;owned\x07", "\x1b]52;c;b3duZWQ=\x07", "\rok\n"
HOSTILE = f"{TITLE}{CLIPBOARD}{RETURN}\x9b2J\u202e"
COMMANDS = Path(terminal.__file__).parent


def obeyed(text: str) -> list[str]:
    """Return what a terminal would not show but obey."""
    return [letter for letter in text if not letter.isprintable() and letter != "\n"]


@pytest.mark.parametrize(
    "show",
    [
        lambda: print_message(HOSTILE, head=HOSTILE),
        lambda: print_line(HOSTILE),
        lambda: print_table((HOSTILE, "b"), [(HOSTILE, 1)]),
    ],
)
def test_what_does_not_show_is_escaped(
    show: Callable[[], None], capsys: pytest.CaptureFixture[str]
) -> None:
    show()
    out = capsys.readouterr()
    assert not obeyed(out.out + out.err)
    assert "\\x1b]0;owned\\x07" in (out.out + out.err).replace("\n", "").replace(" ", "")


def test_the_name_of_a_trial_is_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    with display_progress(f"[/bold]{HOSTILE}") as advance:
        advance(1, 2)
    assert "owned\x07" not in capsys.readouterr().err


@pytest.mark.parametrize("path", sorted(COMMANDS.glob("*.py")), ids=lambda path: path.stem)
def test_commands_print_through_one_door(path: Path) -> None:
    """print() is for JSON, which escapes what does not show; consoles are those of the door."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call) or path.stem == "terminal":
            continue
        words = ast.unparse(node.func)
        json = node.args and ast.unparse(node.args[0]).startswith(("json.dumps(", "json_text("))
        assert words != "print" or json, ast.unparse(node)
        assert not words.endswith((".print", "Console", ".echo", "stdout.write")), ast.unparse(node)


@pytest.mark.parametrize("command", [["log", "info"], ["log", "check"], ["recover"]])
def test_no_event_of_a_log_is_obeyed(tmp_path: Path, command: list[str], call: Call) -> None:
    told = {"kind": "recording_stopped", "data": "{}", "message": HOSTILE, "source": HOSTILE}
    with BagWriter(tmp_path / "bag", {"trial": f"name: '{TITLE!a}'"}) as writer:
        writer.write("/events", TOPICS["/events"].type, encode(TOPICS["/events"].type, told), 1)
    _, out, err = call(*command, tmp_path / "bag")
    assert out
    assert not obeyed(out + err)


def test_a_table_for_a_program_has_a_line_for_each_row(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    digest = 64 * "a"
    print_table(("metric", "value"), [("trajectory_hash", digest), (200 * "x", 1)])
    _, first, second = capsys.readouterr().out.splitlines()
    assert first.split() == ["trajectory_hash", digest]
    assert second.split() == [200 * "x", "1"]
