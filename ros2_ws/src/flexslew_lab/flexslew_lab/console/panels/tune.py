"""Change the gains of a controller while it works."""

from contextlib import suppress
from typing import Any

from flexslew_control.controllers import CONTROLLERS, with_file
from flexslew_lab.console.current_trial import settings_of
from flexslew_lab.console.desk import PanelContext, ReplyLine, line
from flexslew_lab.console.forms import Form, FormKey, OpenedOn, moment, not_negative, text_of
from flexslew_lab.console.link import RequestResult
from flexslew_lab.console.panels.cards import NO_CONTROLLER
from flexslew_lab.console.view import ControllerView
from flexslew_lab.trial.overrides import override_values
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.settings_fields import describe_fields
from flexslew_plant.settings import flat, validated
from flexslew_plant.yaml_data import yaml_text

_HANDOVER, _FROM, _FILE = "handover_time", "tuned from", "file"
_READ_HERE = "law to load: .mat, .npz, .yaml or .json, read where the console runs"


class TunePanel:
    """The settings of one controller.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        gui = context.gui
        self._context, self._view = context, context.view
        with gui.folder("Gains", visible=False) as self._whole:
            self._which = gui.choice("Tuned controller", (NO_CONTROLLER,))
            self._opened = OpenedOn(self._which)
            self._place = gui.add("stack")
            time = FormKey(_FROM, "simulated time [s]; empty: the next tick")
            self._at = Form(context, [time], self._place)
            self._loop = gui.html()
            with gui.add("row"):
                context.click(gui.button("Apply the gains"), self._tune)
                context.click(gui.button("Close", color="blue-grey-8"), self._close)
            self._reply = ReplyLine(context)
        self._form: Form | None = None
        self._last_form = ("", "")  # name and settings in the form

    def open(self, name: str) -> None:
        """Show the gains of a controller."""
        self._which.value, self._whole.visible = name, True

    def _close(self, who: str) -> None:
        self._whole.visible = False

    def refresh(self) -> None:
        """List the controllers, opened on the active one; make the form again for another one."""
        if self._view.now.state == "finished":
            self._whole.visible = False
        names = tuple(sorted(self._view.controllers))
        self._opened.offer(names, NO_CONTROLLER, self._view.now.active)
        known = self._view.controllers.get(self._which.value)
        state = (known.name, known.settings) if known else ("", "")
        if state != self._last_form:
            self._last_form = state
            if self._form is not None:
                self._form.remove()
            self._form = (
                Form(self._context, _keys(*state, known.law), self._place, True) if known else None
            )
        self._loop.content = line(self._stability(known)) if self._whole.visible else ""

    def _stability(self, known: ControllerView | None) -> str:
        """Return the stability of the linear loop with the gains in the fields, and now."""
        changes = self._form.changes() if self._form is not None else None
        if known is None or changes is None or _FILE in changes:
            return ""
        try:
            _check(known.law, known.settings, changes)
        except BadInput:  # the field says so once the gains are applied
            return ""
        now = self._context.margins.of(known.name).words or "computing ..."
        if not changes:
            return f"Linear loop: {now}"
        words = self._context.margins.of(known.name, changes).words or "computing ..."
        return f"Linear loop with these gains: {words}. Now: {now}"

    def _tune(self, who: str) -> None:
        known = self._view.controllers.get(self._which.value)
        if known is None or self._form is None:
            return

        def new_gains(changes: dict[str, Any]) -> str:
            if not changes:
                raise BadInput("nothing has changed; write another value into a field")
            changes = with_file(known.law, changes, known.name)
            _check(known.law, known.settings, changes)
            return yaml_text(override_values({}, changes), flow=True)

        try:
            when = self._at.checked(lambda at: moment(_FROM, at.get(_FROM, 0.0)))
            text = self._form.checked(new_gains, changed=True)
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        if text is not None and when is not None:
            values = {"settings": text, "at": when, "who": who}
            self._reply.ask(f"{known.name}/tune", values)


def _keys(name: str, text: str, law: str) -> list[FormKey]:
    """Return a field for each setting that is no section of its own."""
    settings = settings_of(text)
    law_settings = {key: value for key, value in settings.items() if key != _HANDOVER}
    words = {_HANDOVER: "blends in from the last effort [s]; at least 0"}
    with suppress(BadInput, LookupError):  # no law of this release, or other settings than its own
        section = validated(CONTROLLERS[law].settings, law_settings, name)
        words |= {key: meaning.description for key, meaning in describe_fields(section).items()}
        unset = {key: None for key, value in law_settings.items() if value is None}
        file = [FormKey(_FILE, _READ_HERE)] if CONTROLLERS[law].from_file else []
        return file + [
            FormKey(k, words.get(k, ""), text_of(v)) for k, v in {**flat(settings), **unset}.items()
        ]
    return [FormKey(k, words.get(k, ""), text_of(v)) for k, v in flat(settings).items()]


def _check(law: str, text: str, changes: dict[str, object]) -> None:
    """Check changes as the controller will, before anything is sent.

    Raises:
        BadInput: beginning with the key.
    """
    if law not in CONTROLLERS:
        return
    values = override_values(settings_of(text), changes)
    not_negative(_HANDOVER, values.pop(_HANDOVER, 1.0))
    validated(CONTROLLERS[law].settings, values, "")
