"""What the four charts show, by name, kept in a file of the user."""

import json
import os
from contextlib import suppress
from pathlib import Path

from flexslew_lab.console import quantities
from flexslew_plant.errors import BadInput

CHART_COUNT, _MAX_LENGTH = 4, 60
_BUILT_IN = {
    "flight": (quantities.POSITION, quantities.ERROR, quantities.EFFORT, quantities.TIPS),
    "estimation": (
        quantities.POSITION, quantities.ESTIMATE, quantities.INNOVATION, quantities.EFFORT,
    ),
    "motion": (quantities.POSITION, quantities.VELOCITY, quantities.ERROR, quantities.TIPS),
}  # fmt: skip


def layout_file() -> Path:
    """Return where a user's layouts are kept."""
    home = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(home) / "flexslew" / "console_layouts.json"


class Layouts:
    """Layouts by name, those of the file after those that are built in.

    Args:
        file: that is read, and written by `save` and `choose`; one that cannot be read holds none.
        allowed: what a chart can show.

    Attributes:
        known: by name, one quantity per chart.
        last: the name that was chosen last.
    """

    def __init__(self, file: Path, allowed: tuple[str, ...]) -> None:
        self._file, self._allowed = file, allowed
        self.known: dict[str, tuple[str, ...]] = dict(_BUILT_IN)
        self.last = next(iter(_BUILT_IN))
        found: object = {}
        with suppress(OSError, ValueError):
            found = json.loads(file.read_text())
        if isinstance(found, dict):
            layouts = found.get("layouts")
            for name, selection in layouts.items() if isinstance(layouts, dict) else ():
                if name not in self.known and self._valid(selection):
                    self.known[str(name)[:_MAX_LENGTH]] = tuple(selection)
            if found.get("last") in self.known:
                self.last = str(found["last"])

    def active_plots(self) -> tuple[str, ...]:
        """Return what the charts show, in their order."""
        return self.known[self.last]

    def choose(self, name: str) -> None:
        """Take a layout, also the next time."""
        self.last = name if name in self.known else self.last
        with suppress(OSError):  # it holds for this session then
            self._write()

    def save(self, name: str, selection: list[str]) -> None:
        """Keep a layout under a name.

        Raises:
            BadInput: the name is none, or one of those that are built in.
            OSError: the file cannot be written.
        """
        name = name.strip()
        if not name or len(name) > _MAX_LENGTH or name in _BUILT_IN:
            words = f"write one of at most {_MAX_LENGTH} characters, not {', '.join(_BUILT_IN)}"
            raise BadInput(words, key="Name of the layout", value=name[:_MAX_LENGTH])
        self.known[name], self.last = tuple(selection), name
        self._write()

    def _valid(self, selection: object) -> bool:
        return (
            isinstance(selection, list)
            and len(selection) == CHART_COUNT
            and all(one in self._allowed for one in selection)
        )

    def _write(self) -> None:
        user_entries = {
            name: selection for name, selection in self.known.items() if name not in _BUILT_IN
        }
        self._file.parent.mkdir(parents=True, exist_ok=True)
        self._file.write_text(json.dumps({"last": self.last, "layouts": user_entries}, indent=1))
