"""The elements of the page as one browser shows them, by NiceGUI."""

import html
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from nicegui import background_tasks, ui

from flexslew_lab.console.charting import expression, full_chart
from flexslew_lab.console.gui import Element, Gui, accepted
from flexslew_lab.console.scene_drawing import SceneWidget
from flexslew_lab.console.sheet import PRIMARY, SCRIPT, SHEET
from flexslew_lab.console.uploads import UploadedFile
from flexslew_plant.given_file import LARGEST

# of other elements
_PLACES = ("folder", "details", "tools", "grid", "row", "stack", "card", "tile", "handle")
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
_WAIT_FOR_FRAME = "return new Promise(then => requestAnimationFrame(() => setTimeout(then, 0)))"
_HIDDEN_TIMEOUT = 30.0  # after which such a page gets the next pictures all the same [wall s]


class PageView:
    """One browser's page.

    Args:
        gui: elements of the page.
        number: number of the page.
        notify: called with one line when the page sends what cannot be read.
        show: updates all pages with what has changed.
    """

    def __init__(
        self, gui: Gui, number: int, notify: Callable[[str], None], show: Callable[[], None]
    ) -> None:
        self.gui, self.number, self.closed = gui, number, False
        self._notify, self._show, self._client = notify, show, ui.context.client
        self._widgets: dict[Element, Any] = {}
        self._render_pending = (
            False  # large data was sent since the page last reported a finished drawing
        )
        self._render_active = False  # the page has not yet reported the end of its drawing
        self._late: dict[Element, None] = {}  # what has changed since
        self._client.on_delete(self._close)
        self._client.on_connect(self._catch_up)
        ui.add_css(SHEET)
        ui.colors(primary=PRIMARY)
        ui.add_head_html(f"<script>{SCRIPT}</script>")
        with ui.header().classes("bench-header"):
            self._place(gui.header, "bench-top")
        with ui.element("div").classes("bench-page"):
            self._place(gui.left, "bench-left")
            self._place(gui.middle, "bench-middle")
            self._place(gui.right, "bench-right")

    async def settle(self) -> None:
        """Ask whether the browser draws in three dimensions."""
        try:
            await self._client.connected(_PATIENCE)
            render_support = await self._client.run_javascript(
                f"return {_WEBGL}", timeout=_PATIENCE
            )
        except TimeoutError:
            return
        for element, widget in self._widgets.items():
            if isinstance(widget, SceneWidget):
                widget.render_support = render_support if render_support in (1, 2) else 0
                widget.show(element.data)

    def update(self, element: Element) -> None:
        """Show what has changed of an element; what is large once the page has drawn the last."""
        widget = self._widgets.get(element)
        if widget is None or self.closed:
            return
        if element.kind in _LARGE:
            if self._render_active:
                self._late[element] = None
                return
            self._render_pending = True
        with self._client:
            if element.kind in ("column", *_PLACES):
                self._update_children(element, widget)
            _UPDATES.get(element.kind, _no_update)(self, element, widget)
            _update_state(widget, element)

    def track(self) -> None:
        """Let the page report when it has drawn what was sent to it."""
        if self._render_pending and self.connected and not self._render_active:
            self._render_pending, self._render_active = False, True
            background_tasks.create(self._wait_for_render())

    async def _wait_for_render(self) -> None:
        with suppress(TimeoutError), self._client:
            await self._client.run_javascript(_WAIT_FOR_FRAME, timeout=_HIDDEN_TIMEOUT)
        self._render_active, late, self._late = False, self._late, {}
        for element in late:
            self.update(element)
        self.track()

    def _close(self) -> None:
        self.closed = True

    def _catch_up(self) -> None:
        """Draw again what was not sent while no browser was connected."""
        for element in list(self._widgets):
            if element.kind in _LARGE:
                self.update(element)
        self.track()

    def _place(self, element: Element, name: str) -> None:
        with ui.element("div").classes(name) as widget:
            self._widgets[element] = widget
            for child in element.children:
                self.draw(child)

    def draw(self, element: Element) -> None:
        """Add an element and what is in it."""
        widget = _WIDGETS[element.kind](self, element)
        self._widgets[element] = widget
        if element.kind in _PLACES:
            with widget:
                for child in element.children:
                    self.draw(child)
        _update_state(widget, element)

    def _update_children(self, element: Element, widget: Any) -> None:
        """Add and take away what has come to a place and gone from it."""
        here = set(element.all())
        for removed in [e for e in self._widgets if e.parent is element and e not in here]:
            for one in removed.all():
                found = self._widgets.pop(one, None)
                if one is removed and found is not None:
                    found.delete()
        with widget:
            for child in element.children:
                if child not in self._widgets:
                    self.draw(child)

    def written(self, element: Element, value: Any) -> None:
        """Take what the page has written into a field."""
        try:
            value = accepted(element, value)
        except ValueError as error:
            self._notify(f"page {self.number} sent invalid data: {error!r:.200}")
            return
        if value == element.value or not _accepts_input(element):
            return
        element.value = value
        for callback in element.changed:
            callback(self.number)
        self._show()

    def received(self, element: Element, file: UploadedFile) -> None:
        """Take a file that the page has sent."""
        if _accepts_input(element):
            element.value.append(file)
            for callback in element.changed:
                callback(self.number)

    def on_click(self, element: Element) -> None:
        """Take a click."""
        if _accepts_input(element):
            for callback in element.on_click:
                callback(self.number)

    @property
    def connected(self) -> bool:
        """Whether a browser is connected; data sent now does not queue up."""
        return bool(self._client.has_socket_connection)


def _accepts_input(element: Element) -> bool:
    """Return whether an element can be worked: it is on the page, seen and enabled."""
    return (
        element.visible
        and element.enabled
        and (element.parent is None or _accepts_input(element.parent))
    )


def _update_state(widget: Any, element: Element) -> None:
    if not isinstance(widget, SceneWidget):
        widget.set_visibility(element.visible)
        if isinstance(widget, ui.button) and widget.enabled != element.enabled:
            widget.set_enabled(element.enabled)


def _field(make: Callable[[Element], Any], view: PageView, element: Element) -> Any:
    widget = make(element).classes("bench-field").props("dense outlined stack-label")
    widget.on_value_change(lambda e: view.written(element, e.value))
    if element.hint:
        widget.tooltip(element.hint)
    return widget


def _button(view: PageView, element: Element, act: Callable[[], object] | None = None) -> Any:
    widget = ui.button(element.label, on_click=act or (lambda: view.on_click(element)))
    widget.props(f"no-caps dense unelevated color={element.color or 'primary'}")
    _set_key(widget, element)
    if element.kind == "brake":
        widget.props("id=brake")
    if element.hint:
        widget.tooltip(element.hint)
    return widget


def _save(view: PageView, element: Element) -> Any:
    """Return a button with a menu that saves the chart next to it, by the browser."""
    place = view._widgets[element.data].id
    widget = ui.button(element.label).props("no-caps dense unelevated color=blue-grey-8")
    with widget.tooltip(element.hint), ui.menu():
        for kind in element.options:
            ui.menu_item(kind).on("click", js_handler=f"() => saveChart({place}, '{kind}')")
    return widget


def _set_key(widget: Any, element: Element) -> None:
    if element.key:
        widget.props["aria-keyshortcuts"] = element.key


def _dialog(view: PageView, element: Element, text: str, confirm: bool) -> Any:
    """Return a button that opens a dialog; the same button in it confirms a question."""
    with ui.dialog() as dialog, ui.card().classes("bench-dialog"):
        ui.html(text, sanitize=False)
        with ui.element("div").classes("bench-row"):
            if confirm:
                yes = ui.button(f"{element.label} now", on_click=lambda: view.on_click(element))
                yes.on_click(dialog.close).props("no-caps dense unelevated color=negative")
            close = ui.button("Cancel" if confirm else "Close", on_click=dialog.close)
            close.props("no-caps dense unelevated autofocus color=blue-grey-8")
    return _button(view, element, dialog.open)


def _help(view: PageView, element: Element) -> Any:
    keys = {"Space": "brake", "Enter": "press what has the focus", "Esc": "close a dialog"}
    fixed = [e for e in view.gui.all() if e.key and not e.key.isdigit()]  # cards come and go
    keys |= {e.key: e.hint or e.label for e in fixed} | element.data
    rows = (f"<tr><td><kbd>{k}</kbd><td>{html.escape(what)}" for k, what in keys.items())
    return _dialog(view, element, f"<h2>Keys</h2><table>{''.join(rows)}</table>", False)


def _slider(element: Element) -> Any:
    widget = ui.slider(min=element.low, max=element.high, step=element.step, value=element.value)
    widget.props["aria-label"] = element.label
    return widget.props("label").classes("bench-slider")


def _check(element: Element) -> Any:
    widget = ui.checkbox(element.label, value=element.value)
    widget.props["aria-label"] = element.label
    return widget


def _folder(view: PageView, element: Element) -> Any:
    with ui.element("fieldset").classes("bench-folder") as widget:
        if element.label:
            ui.html(element.label, sanitize=False, tag="legend")
    return widget


def _upload(view: PageView, element: Element) -> Any:
    """Return a place that files are dropped onto, or chosen for; sent at once, one by one."""

    async def take(event: Any) -> None:
        content = await event.file.read()
        view.received(element, UploadedFile(str(event.file.name), content))

    widget = ui.upload(label=element.label, on_upload=take, multiple=True, auto_upload=True,
                       max_file_size=LARGEST)  # fmt: skip
    # the button and the input of the widget have an icon and no name
    name = f"e => e.setAttribute('aria-label', {element.label!r})"
    named = f"node.el.querySelectorAll('a, input').forEach({name})"
    # a button must not contain another control, which this input counts as; a link may
    role = "node.el.querySelectorAll('a').forEach(e => e.setAttribute('role', 'link'))"
    widget.on("vnodeMounted", js_handler=f"node => {{ {named}; {role}; }}")
    return widget.props(f"accept={','.join(element.options)} flat bordered").classes("bench-field")


def _tile(view: PageView, element: Element) -> Any:
    """Return a place that another one can be dragged onto, by its handle."""
    widget = _folder(view, element).on("dragover", js_handler="e => e.preventDefault()")
    drop = "e => { e.preventDefault(); emit(e.dataTransfer.getData('text/plain')); }"
    return widget.on("drop", lambda e: view.written(element, e.args), js_handler=drop)


def _handle(view: PageView, element: Element) -> Any:
    start = f"e => e.dataTransfer.setData('text/plain', '{element.value}')"
    widget = ui.element("div").classes("bench-row").props("draggable=true")
    return widget.on("dragstart", js_handler=start)


def _details(view: PageView, element: Element) -> Any:
    with ui.element("details") as widget:
        ui.html(element.label, sanitize=False, tag="summary")
    return widget


def _tabs(view: PageView, element: Element) -> Any:
    with ui.element("div").classes("bench-tabs") as whole_place:
        with ui.tabs().props("dense no-caps inline-label") as bar:
            for child in element.children:
                view._widgets[child] = tab = ui.tab(child.label)
                _set_key(tab, child)
        with ui.tab_panels(bar, value=element.children[0].label, animated=False) as panels:
            for child in element.children:
                with ui.tab_panel(child.label):
                    for below in child.children:
                        view.draw(below)
    whole_place.panels = panels  # type: ignore[attr-defined]
    for child in element.children:
        _update_state(view._widgets[child], child)
    return whole_place


def _show_tab(view: PageView, element: Element, widget: Any) -> None:
    """Leave a tab that has gone for the last one that is there."""
    tabs = element.parent.children if element.parent else ()
    panels = view._widgets[element.parent].panels if element.parent else None
    if panels is not None and not element.visible and panels.value == element.label:
        panels.value = [tab.label for tab in tabs if tab.visible][-1]


def _table(view: PageView, element: Element) -> Any:
    columns = [
        {"name": name, "field": name, "label": name, "align": "left"} for name in element.options
    ]
    widget = ui.table(columns=columns, rows=element.data or [], row_key="id")
    widget.props("dense flat wrap-cells hide-bottom").classes("bench-table")

    def on_row_click(event: Any) -> None:
        try:
            element.value = int(event.args[1]["id"])
        except (LookupError, TypeError, ValueError):
            return
        view.on_click(element)

    widget.on("row-click", on_row_click, [[], ["id"], []])
    return widget


def _chart(view: PageView, element: Element) -> Any:
    widget = ui.echart(full_chart(element.data), renderer="svg").classes("bench-chart")
    widget.props["aria-label"] = element.label
    widget.structure = element.data.options  # type: ignore[attr-defined]
    return widget


def _show_chart(view: PageView, element: Element, widget: Any) -> None:
    if not view.connected or not element.visible:
        return
    is_new = widget.structure is not element.data.options
    widget.structure = element.data.options
    with widget.props.suspend_updates():  # for a browser that fetches all of it later
        widget.props["options"] = full_chart(element.data)
    if is_new:
        widget.run_chart_method(":setOption", expression(widget.options), "true")
    else:
        widget.run_chart_method("setOption", element.data.updates)


def _set_label(view: PageView, element: Element, widget: Any) -> None:
    widget.set_text(element.label)


def _set_value(view: PageView, element: Element, widget: Any) -> None:
    value = _field_value(element)
    if widget.value != value:
        widget.value = value


def _field_value(element: Element) -> Any:
    """Return what a field shows: nothing where it holds NaN, or an option that has gone."""
    value = element.value
    removed = element.kind == "choice" and value not in element.options
    return None if removed or value != value else value


def _set_options(view: PageView, element: Element, widget: Any) -> None:
    if widget.options != list(element.options):
        widget.set_options(list(element.options), value=_field_value(element))
    else:
        _set_value(view, element, widget)


def _set_content(view: PageView, element: Element, widget: Any) -> None:
    widget.set_content(element.content)


def _set_rows(view: PageView, element: Element, widget: Any) -> None:
    widget.rows = element.data


def _show_scene(view: PageView, element: Element, widget: Any) -> None:
    if view.connected:
        widget.show(element.data)


def _no_update(view: PageView, element: Element, widget: Any) -> None:
    """A place has only what is in it."""


def _scene(view: PageView, element: Element) -> Any:
    return SceneWidget()


_WIDGETS: dict[str, Callable[[PageView, Element], Any]] = {
    "button": _button,
    "brake": _button,
    "confirm": lambda view, e: _dialog(view, e, html.escape(e.hint), True),
    "help": _help,
    "save": _save,
    "text": partial(_field, lambda e: ui.input(e.label, value=e.value)),
    "lines": partial(_field, lambda e: ui.textarea(e.label, value=e.value)),
    "number": partial(_field, lambda e: ui.number(e.label, value=_field_value(e), step=e.step)),
    "choice": partial(
        _field, lambda e: ui.select(list(e.options), label=e.label, value=_field_value(e))
    ),
    "check": partial(_field, _check),
    "slider": partial(_field, _slider),
    "html": lambda view, e: ui.html(e.content, sanitize=False),
    "upload": _upload,
    "folder": _folder,
    "details": _details,
    "tile": _tile,
    "handle": _handle,
    "stack": lambda view, e: ui.element("div"),
    "card": lambda view, e: ui.element("div").classes("bench-card"),
    "tools": lambda view, e: ui.element("div").classes("bench-tools"),
    "grid": lambda view, e: ui.element("div").classes("bench-grid"),
    "row": lambda view, e: ui.element("div").classes("bench-row"),
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
