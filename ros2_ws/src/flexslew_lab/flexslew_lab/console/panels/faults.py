"""Disturb the joints, break parts of the bench, and end both."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from flexslew_lab.console.desk import PanelContext, ReplyLine, line
from flexslew_lab.console.forms import Form, FormKey, keys_of, moment, number_of
from flexslew_lab.console.link import RequestResult
from flexslew_plant.bench.schedule import requested_entry
from flexslew_plant.errors import BadInput
from flexslew_plant.faults import FAULTS
from flexslew_plant.graph import topics
from flexslew_plant.hardware.disturbances import PulseShape, SineShape
from flexslew_plant.keys.units import in_si
from flexslew_plant.yaml_data import yaml_text

_CONSTANT = "constant"
_EFFORT = "constant effort"
_SHAPES: dict[str, type[Any]] = {"sine": SineShape, "pulse": PulseShape}
_WHEN = [
    FormKey("from", "simulated time [s]; empty: the next tick"),
    FormKey("until", "simulated time [s]; empty: to the end of the run"),
]
Made = Callable[[dict[str, Any]], dict[str, Any]]  # from what the fields hold to a schedule entry


class _RequestForm:
    """A form with keys that follow a choice, and the button that sends it."""

    def __init__(
        self, context: PanelContext, label: str, options: tuple[str, ...], button: str
    ) -> None:
        gui = context.gui
        self._context, self._view = context, context.view
        self.choice = gui.choice(label, options)
        self._place = gui.folder(label)
        self._form: Form | None = None
        self._last_state: tuple[Any, ...] = ()
        self.button = gui.button(button)
        self._reply = ReplyLine(context)

    def show(self, keys: Callable[[str], list[FormKey]]) -> None:
        """Make the form again if the choice or the bench has changed."""
        state = (self.choice.value, self._view.joints, tuple(sorted(self._view.controllers)))
        if state == self._last_state or self._view.joints is None:
            return
        self._last_state = state
        if self._form is not None:
            self._form.remove()
        self._form = Form(self._context, [*keys(self.choice.value), *_WHEN], self._place)

    def send(self, who: str, made: Made) -> None:
        """Check the entry as the bench will; send it, or show its error next to the field."""

        def entry(given: dict[str, Any]) -> dict[str, Any]:
            at = moment("from", given.pop("from", 0.0))
            if 0.0 < at <= self._view.time:
                words = f"{at:g} is past: the bench is at {self._view.time:.2f} s"
                raise BadInput(words, key="from")
            until = {"until": given.pop("until")} if "until" in given else {}
            try:
                text = yaml_text({**made(given), **until}, flow=True)
                requested_entry(text, at)
            except BadInput as error:
                why = error.refusal  # its key is that of the field
                raise BadInput(replace(why, source="", key=why.key.rpartition(".")[2])) from None
            return {"fault": text, "at": at, "who": who}

        try:
            values = self._form.checked(entry, as_written=True) if self._form else None
        except BadInput as error:
            self._reply.tell(RequestResult(False, str(error)))
            return
        if values is not None:
            self._reply.ask(topics.INJECT_FAULT, values)


class DisturbancePanel:
    """An effort on a joint: constant, sine or pulse.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        self._view = context.view
        self._request_form = _RequestForm(context, "Disturbance", (_CONSTANT, *_SHAPES), "Disturb")
        context.click(
            self._request_form.button, lambda who: self._request_form.send(who, self._made)
        )

    def refresh(self) -> None:
        """Follow the choice."""
        self._request_form.show(self._keys)

    def _keys(self, shape: str) -> list[FormKey]:
        joints = self._view.joints.names if self._view.joints else ()
        first = FormKey("on joint", "", joints[0] if joints else "", joints)
        if shape in _SHAPES:
            return [first, *keys_of(_SHAPES[shape])]
        return [first, FormKey(_EFFORT, "[N m or N]", "5.0")]

    def _made(self, given: dict[str, Any]) -> dict[str, Any]:
        joint, shape = str(given.pop("on joint", "")), self._request_form.choice.value
        if shape in _SHAPES:
            return {"disturbance": {joint: {shape: given}}}
        number_of(_EFFORT, in_si(given.get(_EFFORT), ("N m", "N")))
        return {"disturbance": {joint: given[_EFFORT]}}


class FaultPanel:
    """A fault of any kind.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        self._view = context.view
        self._request_form = _RequestForm(context, "Fault", tuple(FAULTS), "Break")
        context.click(
            self._request_form.button, lambda who: self._request_form.send(who, self._made)
        )

    def refresh(self) -> None:
        """Follow the choice."""
        self._request_form.show(self._keys)

    def _keys(self, kind: str) -> list[FormKey]:
        if kind not in FAULTS or self._view.joints is None:
            return []
        joints = self._view.joints
        known = {
            "joint": joints.names,
            "of": (*joints.names, *joints.appendages),
            "controller": tuple(sorted(self._view.controllers)),
        }
        return keys_of(FAULTS[kind].settings, ("kind",), known)

    def _made(self, given: dict[str, Any]) -> dict[str, Any]:
        kind = self._request_form.choice.value
        if kind not in FAULTS:
            raise BadInput(", ".join(FAULTS), key="Fault", value=kind)
        return {"fault": {"kind": kind, **given}}


class ActivePanel:
    """What disturbs or breaks now, or will; a button ends each.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        self._context, self._view = context, context.view
        self._place = context.gui.folder("Active")
        self._reply = ReplyLine(context)
        self._listed: tuple[tuple[int, str], ...] | None = None

    def refresh(self) -> None:
        """List it."""
        faults, gui = self._view.now.faults, self._context.gui
        if faults == self._listed:
            return
        self._listed, self._place.children = faults, ()
        with self._place:
            for number, words in faults:
                with gui.add("row"):
                    end = gui.button(f"End {number}", hint=words, color="blue-grey-8")
                    gui.html(line(f"{number}: {words}"))
                self._context.click(end, partial(self._end, number))
            if not faults:
                gui.html(line("no disturbance and no fault"))

    def _end(self, number: int, who: str) -> None:
        self._reply.ask(topics.END_FAULT, {"number": number, "who": who})
