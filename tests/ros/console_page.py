"""A console with its bench as a process, and the page as a person sees it."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.browser import Browser

_CLOSED = "return !document.querySelector('[role=option]')"
_STATE = "return (document.getElementById('bench-state')?.innerText || '').includes(arguments[0])"


class Page:
    """What a person does with the page."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def click(self, name: str) -> None:
        self.browser.click(f"//button[not(@role='tab') and normalize-space()='{name}']")

    def tab(self, name: str) -> None:
        self.browser.click(f"//*[@role='tab' and normalize-space()='{name}']")

    def write(self, label: str, text: str) -> None:
        self.browser.write(_field(label), text)

    def choose(self, label: str, option: str) -> None:
        self.browser.click(f"{_field(label)}/ancestor::label")
        requested = f"@role='option' and normalize-space()='{option}'"
        self.browser.click(f"//*[{requested}]")
        self.browser.until(_CLOSED)

    def state(self, words: str) -> None:
        """Wait until the state of the bench says this."""
        self.browser.until(_STATE, words)

    def says(self, words: str) -> None:
        """Wait until it stands anywhere on the page."""
        self.browser.until("return document.body.innerText.includes(arguments[0])", words)


def _field(label: str) -> str:
    """Return the path of a labelled field."""
    named = f"@aria-label='{label}' or starts-with(@aria-label, '{label} [')"
    return f"(//*[(self::input or self::textarea) and ({named})])[last()]"


@contextmanager
def console(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Yield the process of `flexslew console ...` and the address of its page."""
    child = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "flexslew_lab.cli.main",
            "console",
            "--no-browser",
            "--port",
            "0",
            *arguments,
        ],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1", "XDG_CONFIG_HOME": os.devnull},  # nobody's own
    )
    assert child.stderr is not None
    try:
        line = next((line for line in child.stderr if line.startswith("open ")), "")
        assert line, f"it ended with {child.wait(60)}"
        yield child, line.split()[1]
    finally:
        if child.poll() is None:
            child.send_signal(signal.SIGINT)
        _, rest = child.communicate(timeout=120)
        assert "Traceback" not in rest, rest


def trial_file(folder: Path, duration: float, more: str = "") -> Path:
    path = folder / "session.yaml"
    path.write_text(
        f"""
name: session
duration: {duration}
plan:
  method: reference_only
  model: {{variant: complete, modes: 1}}
  goal: {{base_yaw: 0.1, hub_pitch: 0.05}}
  duration: 5.0
controllers: {{pd_feedforward: {{}}, lqr: {{}}}}
allow_faults: true
{more}
"""
    )
    return path
