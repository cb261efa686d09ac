"""The folder of the run, its report, the command that repeats it."""

import html
from pathlib import Path
from typing import Any

from flexslew_lab.console.desk import Desk
from flexslew_lab.console.gate import FILES

_REPORT = "report.html"


class EndPanel:
    """What a run leaves.

    Args:
        desk: of the page.
        files: that the gate serves, by name.
    """

    def __init__(self, desk: Desk, files: dict[str, Path]) -> None:
        gui, self._desk = desk.gui, desk
        folder = Path(desk.link.folder) if desk.link.folder else None
        self._report = folder / _REPORT if folder else None
        if self._report is not None:
            files[_REPORT] = self._report
        rows = [("folder of the run", str(folder) if folder else "not known to this page")]
        if desk.link.command:
            rows.append(("to repeat it", desk.link.command))
        gui.add_html("".join(_row(*row) for row in rows))
        self._button = gui.add_button("Open the report", visible=False)
        self._state = gui.add_html(_row("report", "written when the run is over"))
        desk.click(self._button, self._open)

    def refresh(self) -> None:
        """Offer the report as soon as it is there."""
        there = self._report is not None and self._report.exists()
        if there != self._button.visible:
            self._button.visible = there
            self._state.visible = not there

    def _open(self, who: str) -> None:
        modal: Any = self._desk.gui.add_modal("Report of the run")
        with modal:
            self._desk.gui.add_html(
                f'<iframe title="report of the run" src="{FILES}{_REPORT}" '
                'style="width:100%;height:75vh;border:0"></iframe>'
            )
            close = self._desk.gui.add_button("Close the report")

        def closed(who: str) -> None:
            if not modal.closed:  # by another page
                modal.close()

        self._desk.click(close, closed)


def _row(name: str, value: str) -> str:
    return (
        '<div style="font-size:0.85em;padding:0.2em 0.7em;overflow-wrap:anywhere">'
        f"<b>{html.escape(name)}</b><br><code>{html.escape(value)}</code></div>"
    )
