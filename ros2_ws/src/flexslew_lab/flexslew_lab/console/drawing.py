"""The elements of the page as one browser shows them, by NiceGUI."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from nicegui import background_tasks, ui

from flexslew_lab.console.charting import expression, whole
from flexslew_lab.console.gui import Element, Gui, accepted
from flexslew_lab.console.scene_drawing import SceneDrawing
from flexslew_lab.console.sheet import PRIMARY, SCRIPT, SHEET

_PLACES = ("folder", "tools", "grid")  # of other elements
_LARGE = ("chart", "scene")  # what a page draws for longer than it takes to send
# whether the browser draws in three dimensions: 0 not at all, 1 by the processor, 2 by a card
_WEBGL = """(() => {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return 0;
  const names = gl.getExtension("WEBGL_debug_renderer_info");
  const by = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  return /swiftshader|llvmpipe|software/i.test(by) ? 1 : 2;
})()"""
_PATIENCE = 20.0  # for a page to begin [wall s]
# after the sent data is on the screen; a hidden page waits until it is visible
_DRAWN = "return new Promise(then => requestAnimationFrame(() => setTimeout(then, 0)))"
_ASLEEP = 30.0  # after which such a page gets the next pictures all the same [wall s]


class PageView:
    """One browser's page.

    Args:
        gui: elements of the page.
        number: number of the page.
        say: called with one line when the page sends what cannot be read.
        show: updates all pages with what has changed.
    """

    def __init__(
        self, gui: Gui, number: int, say: Callable[[str], None], show: Callable[[], None]
    ) -> None:
        self.gui, self.number, self.gone = gui, number, False
        self._say, self._show, self._client = say, show, ui.context.client
        self._drawn: dict[Element, Any] = {}
        self._sent = False  # large data was sent since the page last reported a finished drawing
        self._drawing = False  # the page has not yet reported the end of its drawing
        self._late: dict[Element, None] = {}  # what has changed since
        self._client.on_delete(self._leave)
        self._client.on_connect(self._catch_up)
        ui.add_css(SHEET)
        ui.colors(primary=PRIMARY)
        ui.add_head_html(f"<script>{SCRIPT}</script>")
        with ui.header().classes("bench-header"):
            self._place(gui.header, "bench-top")
        with ui.element("div").classes("bench-page"):
            self._place(gui.left, "bench-left")
            self._place(gui.middle, "bench-middle")

    async def settle(self) -> None:
        """Ask whether the browser draws in three dimensions."""
        try:
            await self._client.connected(_PATIENCE)
            able = await self._client.run_javascript(f"return {_WEBGL}", timeout=_PATIENCE)
        except TimeoutError:
            return
        for element, drawn in self._drawn.items():
            if isinstance(drawn, SceneDrawing):
                drawn.able = able if able in (1, 2) else 0
                drawn.show(element.data)

    def update(self, element: Element) -> None:
        """Show what has changed of an element; what is large once the page has drawn the last."""
        drawn = self._drawn.get(element)
        if drawn is None or self.gone:
            return
        if element.kind in _LARGE:
            if self._drawing:
                self._late[element] = None
                return
            self._sent = True
        with self._client:
            if element.kind in ("column", *_PLACES):
                self._follow(element, drawn)
            _UPDATES.get(element.kind, _nothing)(self, element, drawn)
            _see(drawn, element)

    def follow(self) -> None:
        """Let the page report when it has drawn what was sent to it."""
        if self._sent and self.hears and not self._drawing:
            self._sent, self._drawing = False, True
            background_tasks.create(self._until_drawn())

    async def _until_drawn(self) -> None:
        with suppress(TimeoutError), self._client:
            await self._client.run_javascript(_DRAWN, timeout=_ASLEEP)
        self._drawing, late, self._late = False, self._late, {}
        for element in late:
            self.update(element)
        self.follow()

    def _leave(self) -> None:
        self.gone = True

    def _catch_up(self) -> None:
        """Draw again what was not sent while no browser was connected."""
        for element in list(self._drawn):
            if element.kind in _LARGE:
                self.update(element)
        self.follow()

    def _place(self, element: Element, name: str) -> None:
        with ui.element("div").classes(name) as drawn:
            self._drawn[element] = drawn
            for child in element.children:
                self.draw(child)

    def draw(self, element: Element) -> None:
        """Add an element and what is in it."""
        drawn = _DRAWINGS[element.kind](self, element)
        self._drawn[element] = drawn
        if element.kind in _PLACES:
            with drawn:
                for child in element.children:
                    self.draw(child)
        _see(drawn, element)

    def _follow(self, element: Element, drawn: Any) -> None:
        """Add and take away what has come to a place and gone from it."""
        here = set(element.all())
        for gone in [e for e in self._drawn if e.parent is element and e not in here]:
            for one in gone.all():
                found = self._drawn.pop(one, None)
                if one is gone and found is not None:
                    found.delete()
        with drawn:
            for child in element.children:
                if child not in self._drawn:
                    self.draw(child)

    def written(self, element: Element, value: Any) -> None:
        """Take what the page has written into a field."""
        try:
            value = accepted(element, value)
        except ValueError as error:
            self._say(f"page {self.number} sent invalid data: {error!r:.200}")
            return
        if value == element.value or not _is_usable(element):
            return
        element.value = value
        for told in element.changed:
            told(self.number)
        self._show()

    def clicked(self, element: Element) -> None:
        """Take a click."""
        if _is_usable(element):
            for told in element.clicked:
                told(self.number)

    @property
    def hears(self) -> bool:
        """Whether a browser is connected; data sent now does not queue up."""
        return bool(self._client.has_socket_connection)


def _is_usable(element: Element) -> bool:
    """Return whether an element can be worked: it is on the page, seen and enabled."""
    return (
        element.visible
        and element.enabled
        and (element.parent is None or _is_usable(element.parent))
    )


def _see(drawn: Any, element: Element) -> None:
    if not isinstance(drawn, SceneDrawing):
        drawn.set_visibility(element.visible)
        if isinstance(drawn, ui.button) and drawn.enabled != element.enabled:
            drawn.set_enabled(element.enabled)


def _field(make: Callable[[Element], Any], view: PageView, element: Element) -> Any:
    drawn = make(element).classes("bench-field").props("dense outlined stack-label")
    drawn.on_value_change(lambda e: view.written(element, e.value))
    if element.hint:
        drawn.tooltip(element.hint)
    return drawn


def _button(view: PageView, element: Element) -> Any:
    drawn = ui.button(element.label, on_click=lambda: view.clicked(element))
    drawn.props(f"no-caps dense unelevated color={element.color or 'primary'}")
    if element.kind == "brake":
        drawn.props("id=brake")
    if element.hint:
        drawn.tooltip(element.hint)
    return drawn


def _slider(element: Element) -> Any:
    drawn = ui.slider(min=element.low, max=element.high, step=element.step, value=element.value)
    drawn.props["aria-label"] = element.label
    return drawn.props("label").classes("bench-slider")


def _check(element: Element) -> Any:
    drawn = ui.checkbox(element.label, value=element.value)
    drawn.props["aria-label"] = element.label
    return drawn


def _folder(view: PageView, element: Element) -> Any:
    with ui.element("fieldset").classes("bench-folder") as drawn:
        if element.label:
            ui.html(element.label, sanitize=False, tag="legend")
    return drawn


def _tabs(view: PageView, element: Element) -> Any:
    with ui.element("div").classes("bench-tabs") as whole_place:
        with ui.tabs().props("dense no-caps inline-label mobile-arrows outside-arrows") as bar:
            for child in element.children:
                view._drawn[child] = ui.tab(child.label)
        with ui.tab_panels(bar, value=element.children[0].label, animated=False) as panels:
            for child in element.children:
                with ui.tab_panel(child.label):
                    for below in child.children:
                        view.draw(below)
    whole_place.panels = panels  # type: ignore[attr-defined]
    for child in element.children:
        _see(view._drawn[child], child)
    return whole_place


def _show_tab(view: PageView, element: Element, drawn: Any) -> None:
    """Leave a tab that has gone for the last one that is there."""
    tabs = element.parent.children if element.parent else ()
    panels = view._drawn[element.parent].panels if element.parent else None
    if panels is not None and not element.visible and panels.value == element.label:
        panels.value = [tab.label for tab in tabs if tab.visible][-1]


def _table(view: PageView, element: Element) -> Any:
    columns = [
        {"name": name, "field": name, "label": name, "align": "left"} for name in element.options
    ]
    drawn = ui.table(columns=columns, rows=element.data or [], row_key="id")
    drawn.props("dense flat wrap-cells hide-bottom").classes("bench-table")

    def chosen(event: Any) -> None:
        try:
            element.value = int(event.args[1]["id"])
        except (LookupError, TypeError, ValueError):
            return
        view.clicked(element)

    drawn.on("row-click", chosen, [[], ["id"], []])
    return drawn


def _chart(view: PageView, element: Element) -> Any:
    drawn = ui.echart(whole(element.data), renderer="svg").classes("bench-chart")
    drawn.props["aria-label"] = element.label
    drawn.structure = element.data.options  # type: ignore[attr-defined]
    return drawn


def _show_chart(view: PageView, element: Element, drawn: Any) -> None:
    if not view.hears or not element.visible:
        return
    fresh = drawn.structure is not element.data.options
    drawn.structure = element.data.options
    with drawn.props.suspend_updates():  # for a browser that fetches all of it later
        drawn.props["options"] = whole(element.data)
    if fresh:
        drawn.run_chart_method(":setOption", expression(drawn.options), "true")
    else:
        drawn.run_chart_method("setOption", element.data.news)


def _set_label(view: PageView, element: Element, drawn: Any) -> None:
    drawn.set_text(element.label)


def _set_value(view: PageView, element: Element, drawn: Any) -> None:
    value = _displayed_value(element)
    if drawn.value != value:
        drawn.value = value


def _displayed_value(element: Element) -> Any:
    """Return what a field shows: nothing where it holds NaN, or an option that has gone."""
    value = element.value
    gone = element.kind == "choice" and value not in element.options
    return None if gone or value != value else value


def _set_options(view: PageView, element: Element, drawn: Any) -> None:
    if drawn.options != list(element.options):
        drawn.set_options(list(element.options), value=_displayed_value(element))
    else:
        _set_value(view, element, drawn)


def _set_content(view: PageView, element: Element, drawn: Any) -> None:
    drawn.set_content(element.content)


def _set_rows(view: PageView, element: Element, drawn: Any) -> None:
    drawn.rows = element.data


def _show_scene(view: PageView, element: Element, drawn: Any) -> None:
    if view.hears:
        drawn.show(element.data)


def _nothing(view: PageView, element: Element, drawn: Any) -> None:
    """A place has only what is in it."""


def _scene(view: PageView, element: Element) -> Any:
    return SceneDrawing()


_DRAWINGS: dict[str, Callable[[PageView, Element], Any]] = {
    "button": _button,
    "brake": _button,
    "text": partial(_field, lambda e: ui.input(e.label, value=e.value)),
    "lines": partial(_field, lambda e: ui.textarea(e.label, value=e.value)),
    "number": partial(_field, lambda e: ui.number(e.label, value=_displayed_value(e), step=e.step)),
    "choice": partial(
        _field, lambda e: ui.select(list(e.options), label=e.label, value=_displayed_value(e))
    ),
    "check": partial(_field, _check),
    "slider": partial(_field, _slider),
    "html": lambda view, e: ui.html(e.content, sanitize=False),
    "folder": _folder,
    "tools": lambda view, e: ui.element("div").classes("bench-tools"),
    "grid": lambda view, e: ui.element("div").classes("bench-grid"),
    "tabs": _tabs,
    "table": _table,
    "chart": _chart,
    "scene": _scene,
}
_UPDATES: dict[str, Callable[[PageView, Element, Any], None]] = {
    "button": _set_label,
    "brake": _set_label,
    "text": _set_value,
    "lines": _set_value,
    "number": _set_value,
    "choice": _set_options,
    "check": _set_value,
    "slider": _set_value,
    "html": _set_content,
    "tab": _show_tab,
    "table": _set_rows,
    "chart": _show_chart,
    "scene": _show_scene,
}
