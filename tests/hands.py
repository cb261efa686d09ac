"""The page worked as its elements, without a browser."""

from typing import Any

from flexslew_lab.console.gui import Element
from flexslew_lab.console.page import Page
from tests.fake_bench import FakeLink


class Hands:
    """Works the page as its elements, without a browser."""

    def __init__(self, page: Page, link: FakeLink) -> None:
        self.page, self.link, self.gui = page, link, page.server.gui

    def elements(self, label: str) -> list[Element]:
        found = [e for e in self.gui.all() if e.kind not in ("html", "folder", "tab", "slider")]
        return [e for e in found if e.label == label or e.label.startswith(f"{label} [")]

    def set(self, label: str, value: Any) -> None:
        self.elements(label)[-1].value = value  # unchecked

    def click(self, label: str) -> list[tuple[str, dict[str, Any]]]:
        """Return what the bench is asked for."""
        self.link.request.clear()
        for told in self.elements(label)[0].on_click:
            told(3)
        self.page._context.work()
        self.page.refresh()
        return list(self.link.request)

    def seen(self, label: str) -> bool:
        """Return whether anything with this label stands on the page."""
        return any(map(shown, self.elements(label)))

    def refresh(self) -> None:
        self.page.refresh()

    def charts(self) -> list[Element]:
        """Return the charts that stand on the page."""
        return [e for e in self.gui.all() if e.kind == "chart" and shown(e)]

    def titles(self) -> list[str]:
        """Return their titles."""
        return [e.data.options["title"]["text"] for e in self.charts()]

    def texts(self) -> str:
        """Return everything that stands on the page as HTML."""
        return "\n".join(e.content for e in self.gui.all() if shown(e))


def shown(element: Element) -> bool:
    return element.visible and (element.parent is None or shown(element.parent))
