"""The elements of a page as plain data, the same for every browser that opens it.

Panels make and change them; `drawing` shows them in each browser.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from typing import Any

from flexslew_lab.console.uploads import UploadedFile

PageCallback = Callable[[int], None]  # takes the number of the page that did it
_MOST_FILES = 8  # of an upload that wait to be taken
_VISIBLE_FIELDS = frozenset(
    {"label", "value", "options", "visible", "enabled", "content", "data", "children"}
)


class Element:
    """One element. What is assigned to it is shown by all pages.

    Args:
        gui: page data that the element belongs to.
        kind: a key of the table of drawings.
        label: text next to a field, or on a button.
        given: any of the attributes.

    Attributes:
        value: of a field; of an upload, the files that nobody has taken yet; number of the tile
            that was dragged onto a tile.
        options: of a choice, or the columns of a table.
        hint: shown where the pointer rests.
        visible: it is there.
        enabled: it can be worked.
        low, high, step: of a slider or a number.
        content: HTML.
        data: of a chart, a table or a scene; never changed, only replaced. Of a button that saves
            a chart, the place of the chart. Of a help, what more keys do.
        color: of a button.
        key: that works it.
        children: what stands in it.
        parent: that it stands in.
    """

    value: Any = None
    options: tuple[str, ...] = ()
    hint, content, color, key = "", "", "", ""
    visible, enabled = True, True
    low, high, step = 0.0, 1.0, 1.0
    data: Any = None
    children: tuple["Element", ...] = ()
    parent: "Element | None" = None

    def __init__(self, gui: "Gui", kind: str, label: str = "", **given: Any) -> None:
        self.__dict__ |= {"gui": gui, "kind": kind, "label": label, **given}
        self.gui, self.kind, self.label = gui, kind, label
        self.on_click: list[PageCallback] = []
        self.changed: list[PageCallback] = []  # by a page

    def __setattr__(self, name: str, value: Any) -> None:
        old = getattr(self, name, None)
        self.__dict__[name] = value
        if name not in _VISIBLE_FIELDS or old is value:
            return
        if name == "data" or old != value:
            self.gui.updates.append(self)

    def __enter__(self) -> "Element":
        self.gui.places.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        self.gui.places.pop()

    def remove(self) -> None:
        """Take it off the page."""
        if self.parent is not None:
            self.parent.children = tuple(c for c in self.parent.children if c is not self)

    def all(self) -> list["Element"]:
        """Return it and everything in it, in the order of the page."""
        return [self, *(below for child in self.children for below in child.all())]


class Gui:
    """The page.

    Attributes:
        header: what stands above all else, always in sight.
        left: the controllers.
        middle: charts and testbed.
        right: tabs with all else.
        news: elements that have changed and are not drawn yet.
        places: that elements are being added to, the innermost last.
    """

    def __init__(self) -> None:
        self.updates: deque[Element] = deque()
        places = [Element(self, "column") for _ in range(4)]
        self.header, self.left, self.middle, self.right = places
        self.places: list[Element] = [self.left]

    def add(self, kind: str, label: str = "", **more: Any) -> Element:
        """Add an element where elements are being added."""
        found, place = Element(self, kind, label, **more), self.places[-1]
        found.parent = place
        place.children = (*place.children, found)
        return found

    def tabs(self, names: Mapping[str, str]) -> tuple["Element", ...]:
        """Add tabs with these names and keys, and return the place of each."""
        with self.add("tabs") as bar:
            for name, key in names.items():
                self.add("tab", name, key=key)
        return bar.children

    def text(self, label: str, value: str = "", hint: str = "", lines: bool = False) -> Element:
        """Add a field for text."""
        return self.add("lines" if lines else "text", label, value=value, hint=hint)

    def number(self, label: str, value: float, hint: str = "", step: float = 0.1) -> Element:
        """Add a field for a number."""
        return self.add("number", label, value=value, hint=hint, step=step)

    def choice(self, label: str, options: Sequence[str], value: str = "") -> Element:
        """Add a list to choose from."""
        return self.add("choice", label, value=value or options[0], options=tuple(options))

    def check(self, label: str, value: bool, hint: str = "") -> Element:
        """Add a box to tick."""
        return self.add("check", label, value=value, hint=hint)

    def slider(self, label: str, low: float, high: float, step: float, value: float) -> Element:
        """Add a slider below its name."""
        self.html(label)
        return self.add("slider", label, low=low, high=high, step=step, value=value)

    def button(
        self, label: str, hint: str = "", color: str = "", key: str = "", visible: bool = True
    ) -> Element:
        """Add a button."""
        return self.add("button", label, hint=hint, color=color, key=key, visible=visible)

    def upload(self, label: str, endings: Sequence[str]) -> Element:
        """Add a place for files with these endings; pages add an UploadedFile to its value."""
        queue = deque[UploadedFile](maxlen=_MOST_FILES)
        return self.add("upload", label, value=queue, options=tuple(endings))

    def html(self, content: str = "", visible: bool = True) -> Element:
        """Add text as HTML."""
        return self.add("html", content=content, visible=visible)

    def folder(self, label: str = "", visible: bool = True) -> Element:
        """Add a place for elements."""
        return self.add("folder", label, visible=visible)

    def all(self) -> list[Element]:
        """Return every element."""
        return [
            e for place in (self.header, self.left, self.middle, self.right) for e in place.all()
        ]


def accepted(element: Element, value: Any) -> Any:
    """Return what a page sends for a field, as its type.

    Raises:
        ValueError: it cannot be of this field.
    """
    if element.kind in ("text", "lines", "choice") and not isinstance(value, str):
        raise ValueError(f"no text for {element.label!r:.60}")
    if element.kind in ("choice", "tile") and value not in element.options:
        raise ValueError(f"no option of {element.label!r:.60}")
    if element.kind == "check" and not isinstance(value, bool):
        raise ValueError(f"no yes or no for {element.label!r:.60}")
    if element.kind in ("number", "slider"):
        if value is None and element.kind == "number":  # an empty field
            return float("nan")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"no number for {element.label!r:.60}")
        number = float(value)
        if not isfinite(number):
            raise ValueError(f"no finite number for {element.label!r:.60}")
        return min(max(number, element.low), element.high) if element.kind == "slider" else number
    return value
