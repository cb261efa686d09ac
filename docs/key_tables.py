"""The tables of keys in the pages, made from the fields of the sections.

A line `<!-- keys: MODULE.CLASS -->` stands above each, `<!-- kinds: MODULE.TABLE -->` above one of
entries with their keys, `<!-- events: MODULE.TABLE -->` above one of events. After a change of a
section `. setup/environment.sh; python docs/key_tables.py` writes them again;
tests/lab/trial/test_trial_reference.py checks that they are current.
"""

import importlib
import re
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from flexslew_plant.events.event import KINDS as EVENT_KINDS
from flexslew_plant.events.event import Level
from flexslew_plant.keys.settings_fields import FieldDescription, describe_section
from flexslew_plant.yaml_data import yaml_text

DOCS = Path(__file__).parent
NAMES = (
    *("trial", "spacecraft", "start_in_motion", "external_plant"),
    *("external_controller", "tuning"),
    *("studies/keys", "benchmark/rules", "faults/kinds", "ros2/events"),
)
PAGES = (
    *(DOCS / f"{name}.md" for name in NAMES),
    *sorted((DOCS / "controllers").glob("*.md")),
    *sorted((DOCS / "planners").glob("*.md")),
)
MARK = re.compile(r"^<!-- keys: ([\w.]+)\.(\w+) -->\n+(?:\|[^\n]*\n)*", re.MULTILINE)
KINDS = re.compile(
    r"^<!-- kinds: ([\w.]+)\.(\w+) -->\n+(?:\|[^\n]*\n)*(?:\n\| shared [^\n]*\n(?:\|[^\n]*\n)*)?",
    re.MULTILINE,
)
KINDS_HEAD = "| kind | what happens | keys |\n|---|---|---|\n"
SHARED_HEAD = "\n| shared key | meaning |\n|---|---|\n"
SHARED = 3  # kinds with the same text of a key, which then stands once
EVENTS = re.compile(r"^<!-- events: ([\w.]+)\.(\w+) -->\n+(?:\|[^\n]*\n)*", re.MULTILINE)
EVENTS_HEAD = "| kind | level | what happened | data |\n|---|---|---|---|\n"
HEAD = "| key | default | meaning |\n|---|---|---|\n"
_LONGEST = 60  # characters of a default


def section_of(module: str, name: str) -> type[Any]:
    """Return the section that a mark names."""
    found: type[Any] = getattr(importlib.import_module(module), name)
    return found


def table(kind: type[Any]) -> str:
    """Return the table of a section's keys: its own first, then those that it extends."""
    own = set(vars(kind).get("__annotations__", ()))
    items = sorted((f for f in fields(kind) if f.repr), key=lambda f: f.name not in own)
    meanings = describe_section(kind)
    rows = [f"| {f.name} | {default(f)} | {meaning_text(f, meanings[f.name])} |\n" for f in items]
    return HEAD + "".join(rows)


def kinds_table(entries: Mapping[str, Any]) -> str:
    """Return the table of the kinds of entries with their keys, then that of the shared keys."""
    keys = {name: keys_of_kind(entry.settings) for name, entry in entries.items()}
    counts = Counter(pair for own in keys.values() for pair in own.items())
    shared = [pair for pair, count in counts.items() if count >= SHARED]
    rows = []
    for name, entry in entries.items():
        texts = (f"`{k}`" + (f": {v}" * ((k, v) not in shared)) for k, v in keys[name].items())
        words = " ".join((entry.settings.__doc__ or "").split())
        rows.append(f"| {name} | {words} | {'; '.join(texts)} |\n")
    meanings = [f"| `{key}` | {text} |\n" for key, text in shared]
    return "".join((KINDS_HEAD, *rows, *([SHARED_HEAD] if shared else []), *meanings))


def keys_of_kind(settings: type[Any]) -> dict[str, str]:
    """Return the keys of a kind with their meanings, except the key that selects it."""
    meanings = describe_section(settings)
    own = [f for f in fields(settings) if f.repr and f.name != "kind"]
    return {f.name: meaning_text(f, meanings[f.name]) for f in own}


def events_table(kinds: Mapping[str, type[Any]]) -> str:
    """Return the table of the kinds of events: what each says, and the keys of its data."""
    rows = []
    for kind, fact in sorted(kinds.items()):
        words = " ".join((fact.__doc__ or "").split())
        meant = {name: found.words for name, found in describe_section(fact).items()}
        keys = [f"`{f.name.rstrip('_')}`{in_brackets(meant[f.name])}" for f in fields(fact)]
        fixed = EVENT_KINDS[fact].level
        level = fixed if isinstance(fixed, Level) else "info or warning"
        rows.append(f"| {kind} | {level} | {words} | {', '.join(keys)} |\n")
    return EVENTS_HEAD + "".join(rows)


def in_brackets(words: str) -> str:
    """Return the meaning of a key behind its name; empty where the name says it."""
    return f" ({words})".replace("None:", "left out:").replace("|", "\\|") if words else ""


def meaning_text(item: Field[Any], meaning: FieldDescription) -> str:
    """Return what a key means and what is allowed; one that is fixed selects its section."""
    text = meaning.description or f"selects this {item.name}"
    return text.replace("|", "\\|")


def default(item: Field[Any]) -> str:
    """Return the default of a key as YAML; a section's, where all of it is, in a word."""
    value, factory = item.default, item.default_factory
    if isinstance(value, FieldInfo):
        value, factory = value.default, value.default_factory
    if factory is not None and factory is not MISSING:
        value = factory()  # type: ignore[call-arg]
    if value is MISSING or value is PydanticUndefined:
        return "required"
    if hasattr(value, "__dataclass_fields__"):
        return f"kind {value.kind}" if hasattr(value, "kind") else "defaults"
    shown = short(TypeAdapter(Any).dump_python(value, mode="json"))
    text = yaml_text(shown, flow=True).strip().removesuffix("\n...")
    return text.replace("|", "\\|") if len(text) <= _LONGEST else "see the text"


def short(value: Any) -> Any:
    """Return a value with numbers of six digits."""
    if isinstance(value, list):
        return [short(one) for one in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def current(text: str, made: Callable[[type[Any]], str] = table) -> str:
    """Return a page with its tables as the sections have them now."""

    def filled(match: re.Match[str]) -> str:
        mark = f"<!-- keys: {match[1]}.{match[2]} -->\n"
        return f"{mark}\n{made(section_of(match[1], match[2]))}"

    def listed(word: str, rows: Callable[[Any], str], match: re.Match[str]) -> str:
        entries = getattr(importlib.import_module(match[1]), match[2])
        return f"<!-- {word}: {match[1]}.{match[2]} -->\n\n{rows(entries)}"

    text = KINDS.sub(partial(listed, "kinds", kinds_table), MARK.sub(filled, text))
    return EVENTS.sub(partial(listed, "events", events_table), text)


def main() -> None:
    """Write the tables of all pages."""
    for page in PAGES:
        page.write_text(current(page.read_text()))


if __name__ == "__main__":
    sys.exit(main())
