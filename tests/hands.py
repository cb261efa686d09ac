"""The page worked as its elements, without a browser."""

from typing import Any

from flexslew_lab.console.gui import Element, PageCallback
from flexslew_lab.console.page import Page
from tests.fake_bench import FakeLink


class Hands:
    """Works the page as its elements, without a browser."""

    def __init__(self, page: Page, link: FakeLink) -> None:
        self.page, self.link, self.gui = page, link, page.server.gui

    def elements(self, label: str) -> list[Element]:
        found = [e for e in self.gui.all() if e.kind not in ("html", "folder", "tab", "slider")]
        found = [e for e in found if e.label == label or e.label.startswith(f"{label} [")]
        return sorted(
            found, key=lambda e: "Experiment" not in _places(e)
        )  # it has fields of a plan

    def set(self, label: str, value: Any) -> None:
        self.elements(label)[-1].value = value  # unchecked

    def change(self, label: str, value: Any) -> list[tuple[str, dict[str, Any]]]:
        """Write into a field as a page does, and return what the bench is asked for."""
        self.set(label, value)
        return self._told(self.elements(label)[-1].changed)

    def click(self, label: str) -> list[tuple[str, dict[str, Any]]]:
        """Return what the bench is asked for."""
        return self._told(self.elements(label)[0].on_click)

    def _told(self, callbacks: list[PageCallback]) -> list[tuple[str, dict[str, Any]]]:
        self.link.request.clear()
        for told in callbacks:
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


def _places(element: Element) -> list[str]:
    return [element.label, *(_places(element.parent) if element.parent else ())]
