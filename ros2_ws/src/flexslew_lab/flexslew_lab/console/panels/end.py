"""The folder of the run, its report, the command that repeats it."""

import html
from pathlib import Path

from flexslew_lab.console.desk import PanelContext
from flexslew_lab.console.gate import FILES

_REPORT = "report.html"
_OPEN = f'<a href="{FILES}{_REPORT}" target="_blank" rel="noopener">Open the report</a>'


class EndPanel:
    """What a run leaves.

    Args:
        context: of the page.
        files: that the gate serves, by name.
    """

    def __init__(self, context: PanelContext, files: dict[str, Path]) -> None:
        gui = context.gui
        folder = Path(context.link.folder) if context.link.folder else None
        self._report = folder / _REPORT if folder else None
        if self._report is not None:
            files[_REPORT] = self._report
        rows = [("folder of the run", str(folder) if folder else "not known to this page")]
        if context.link.command:
            rows.append(("to repeat it", context.link.command))
        gui.html("".join(_row(*row) for row in rows))
        self._state = gui.html()

    def refresh(self) -> None:
        """Offer the report as soon as it is there."""
        available = self._report is not None and self._report.exists()
        self._state.content = _OPEN if available else _row("report", "written when the run is over")


def _row(name: str, value: str) -> str:
    return (
        '<div style="font-size:0.85em;padding:0.2em 0.7em;overflow-wrap:anywhere">'
        f"<b>{html.escape(name)}</b><br><code>{html.escape(value)}</code></div>"
    )
