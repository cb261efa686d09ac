"""Forms made from sections of settings: a field for each key, with its error next to it."""

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import Any, NamedTuple, TypeVar, get_args

from pydantic import FiniteFloat

from flexslew_lab.console.desk import PanelContext, line
from flexslew_lab.console.gui import Element
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.settings_fields import describe_section
from flexslew_plant.keys.units import in_si, units_in
from flexslew_plant.refusal import Refusal
from flexslew_plant.settings import validated
from flexslew_plant.yaml_data import load_yaml, yaml_text

LATEST = 1e9  # of a simulated time [s]
_MAX_LENGTH = 4000  # characters of a field
_T = TypeVar("_T")


class FormKey(NamedTuple):
    """One field of a form."""

    name: str
    words: str = ""
    text: str = ""  # at first, YAML
    options: tuple[str, ...] = ()  # of a choice; none: any text

    @property
    def label(self) -> str:
        """The name, with the unit from its description in brackets."""
        units = " or ".join(units_in(self.words))
        return f"{self.name} [{units}]" if units else self.name


def text_of(value: Any) -> str:
    """Return a value as a person writes it into a field; None is an empty field."""
    return "" if value is None else yaml_text(value, flow=True).strip().removesuffix("\n...")


def keys_of(
    kind: type[Any], without: tuple[str, ...] = (), known: Mapping[str, tuple[str, ...]] = {}
) -> list[FormKey]:
    """Return a field for each key of a section.

    Args:
        kind: the section.
        without: keys that are left out.
        known: what a key may be, by its name, where the section cannot know.
    """
    words = describe_section(kind)
    found = []
    for item in dataclasses.fields(kind):
        if item.name in without:
            continue
        options = tuple(known.get(item.name, ())) or _choices(item.type)
        required = item.default is dataclasses.MISSING
        given = options[0] if options and required else None if required else item.default
        optional = ("",) if options and not required and given is None else ()
        found.append(
            FormKey(item.name, words[item.name].description, text_of(given), (*optional, *options))
        )
    return found


def number_of(name: str, value: Any) -> float:
    """Return the finite number that a field holds.

    Raises:
        BadInput: it holds none; beginning with the name.
    """
    try:
        return float(validated(FiniteFloat, value, name))
    except BadInput as error:
        raise BadInput(error.refusal.why, key=name, value=value) from None


def moment(name: str, value: Any) -> float:
    """Return the simulated time [s] that a field holds, also as `2 min`; 0 is the next tick.

    Raises:
        BadInput: it holds none; beginning with the name.
    """
    try:
        seconds = in_si(value, ["s"])
    except BadInput as error:
        raise BadInput(dataclasses.replace(error.refusal, key=name)) from None
    return not_negative(name, seconds, LATEST)


def not_negative(name: str, value: Any, below: float = inf) -> float:
    """Return the number that a field holds, from 0 to below a limit.

    Raises:
        BadInput: it holds none; beginning with the name.
    """
    number = number_of(name, value)
    if not 0.0 <= number < below:
        limit = f", below {below:g}" if below < inf else ""
        raise BadInput(f"at least 0{limit}", key=name, value=number)
    return number


def one_of(name: str, value: Any, known: Mapping[str, float]) -> float:
    """Return what a choice stands for.

    Raises:
        BadInput: it is none of them.
    """
    if str(value) not in known:
        raise BadInput(", ".join(known), key=name, value=value)
    return known[str(value)]


def set_options(field: Element, options: tuple[str, ...], empty_text: str) -> None:
    """Set the options of a list; without options it shows the text `empty_text`."""
    choices = options or (empty_text,)
    if choices != field.options:
        field.value = field.value if field.value in choices else choices[0]
        field.options = choices


class OpenedOn:
    """A list of controllers that opens on the one in charge, once, and then is left to people.

    Args:
        field: the list.
    """

    def __init__(self, field: Element) -> None:
        self._field = field
        self._initial_value = field.value  # chosen by the list itself, not by a user
        self._open = False

    def offer(self, options: tuple[str, ...], empty_text: str, active: str) -> None:
        """Let the list offer these; see `offer`."""
        is_user_choice = self._field.value != self._initial_value
        set_options(self._field, options, empty_text)
        if not self._open and active in options:
            self._field.value = self._field.value if is_user_choice else active
            self._open = True
        elif not is_user_choice:
            self._initial_value = self._field.value


def _choices(kind: Any) -> tuple[str, ...]:
    """Return the texts that a Literal allows; none for another type."""
    given = get_args(kind)
    return given if given and all(isinstance(one, str) for one in given) else ()


class Form:
    """Fields below one another; `values` returns what they hold.

    Args:
        context: desk of the page.
        keys: keys of the fields.
        place: folder of the page that contains the fields.
        sliders: add a slider next to each positive number, over two powers of ten.
    """

    def __init__(
        self, context: PanelContext, keys: list[FormKey], place: Element, sliders: bool = False
    ) -> None:
        gui = context.gui
        self._keys = keys
        self._elements: dict[str, Element] = {}
        self._errors: dict[str, Element] = {}
        self._sliders: list[Element] = []
        with place:
            for key in keys:
                if key.options:
                    element = gui.choice(key.label, key.options, key.text)
                    element.hint = key.words
                else:
                    element = gui.text(key.label, key.text, hint=key.words)
                self._elements[key.name] = element
                if sliders and scaled(key.text, 0.0) is not None:
                    self._sliders.append(_slider(context, element, key.text))
                self._errors[key.name] = gui.html(visible=False)
                element.changed.append(partial(self._clear_message, key.name))

    def checked(
        self,
        check: Callable[[dict[str, Any]], _T],
        instead: Mapping[str, Any] = {},
        changed: bool = False,
        as_written: bool = False,
    ) -> _T | None:
        """Return the result of a check of the fields; None: each field that is wrong is marked.

        Args:
            check: takes the values of the fields that are not empty; raises BadInput.
            instead: values with which the check continues after a field that it refuses; it
                continues without another one.
            changed: check only the values of the fields that differ from the start.
            as_written: leave quantities to the bench, which has the kinds of its joints.

        Raises:
            BadInput: no field is wrong; the refusal names none.
        """
        known = {key.name: key.text for key in self._keys} if changed else {}
        values, errors = self._read(known, as_written)
        for name in self._errors:
            self._show_message(name, errors.get(name, ""))
        marked = {*errors}
        while True:
            given = {**values, **{name: v for name, v in instead.items() if name in marked}}
            try:
                result = check(given)
                return None if marked else result
            except BadInput as error:
                name = self._field_of(error.refusal)
                if not (name or marked):
                    raise
                if not name or name in marked:
                    return None
                self._show_message(name, str(error.refusal))
                marked.add(name)
                values.pop(name, None)

    def values(self) -> dict[str, Any] | None:
        """Return the values of the fields that are not empty; None: a field is wrong."""
        return self.checked(lambda values: values)

    def refuse(self, why: Refusal) -> bool:
        """Show a refusal next to the field that it names; return whether there is one."""
        name = self._field_of(why)
        if name:
            self._show_message(name, str(why))
        return bool(name)

    def _field_of(self, why: Refusal) -> str:
        names = sorted(self._errors, key=len, reverse=True)
        found = (name for name in names if why.key == name or why.key.startswith(f"{name}."))
        return next(found, "")

    def set(self, name: str, text: str) -> None:
        """Write into a field."""
        self._elements[name].value = text
        self._show_message(name, "")

    def remove(self) -> None:
        """Take the fields off the page."""
        for element in (*self._elements.values(), *self._errors.values(), *self._sliders):
            element.remove()

    def changes(self) -> dict[str, Any] | None:
        """Return the values of the fields that differ from the start; None: a field is wrong."""
        found, errors = self._read({key.name: key.text for key in self._keys}, False)
        return None if errors else found

    def _read(
        self, known: Mapping[str, str], as_written: bool
    ) -> tuple[dict[str, Any], dict[str, str]]:
        """Return the values that differ from these texts, and errors by field."""
        found: dict[str, Any] = {}
        errors = {}
        for key in self._keys:
            text = str(self._elements[key.name].value)
            if text == known.get(key.name, ""):
                continue
            try:
                found[key.name] = value_of(key, text)
                if as_written and not key.options:
                    found[key.name] = load_yaml(text, key.name)
            except BadInput as error:
                errors[key.name] = str(error)
                found.pop(key.name, None)
        return found, errors

    def _clear_message(self, name: str, _: object) -> None:
        self._show_message(name, "")

    def _show_message(self, name: str, words: str) -> None:
        error = self._errors[name]
        if error.visible != bool(words):
            error.visible = bool(words)
        if words:
            error.content = line(words, "alert")


def scaled(text: str, power: float) -> str | None:
    """Return a positive number, or a list of such, times a power of ten; None: it is none."""
    try:
        found = load_yaml(text, "")
    except BadInput:
        return None
    many = found if isinstance(found, list) else [found]
    if not many or not all(isinstance(one, float) and 0.0 < one < inf for one in many):
        return None
    rows = [float(f"{one * 10.0**power:.4g}") for one in many]
    return text_of(rows if isinstance(found, list) else rows[0])


def _slider(context: PanelContext, field: Element, text: str) -> Element:
    """Add a slider of powers of ten that writes into a field what stood there, scaled."""
    name = f"{field.label}, times a power of ten"
    found = context.gui.add("slider", name, low=-1.0, high=1.0, step=0.01, value=0.0)

    def write(page: int) -> None:
        field.value = (scaled(text, found.value) if found.value else text) or text

    found.changed.append(write)
    return found


def value_of(key: FormKey, text: str) -> Any:
    """Return what a field holds; `57 deg` and `2 min` as numbers in SI.

    Raises:
        BadInput: it is no YAML, none of the choices, or in a unit of another kind.
    """
    if key.options:
        if text not in key.options:
            raise BadInput(", ".join(key.options), key=key.name, value=text)
        return text
    if len(text) > _MAX_LENGTH:
        words = f"{len(text)} characters are too many: at most {_MAX_LENGTH}"
        raise BadInput(words, key=key.name)
    value, units = load_yaml(text, key.name), units_in(key.words)
    try:
        return in_si(value, units) if units else value
    except BadInput as error:
        raise BadInput(dataclasses.replace(error.refusal, key=key.name)) from None
