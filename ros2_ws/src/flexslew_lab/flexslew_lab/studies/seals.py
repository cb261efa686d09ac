"""Files that carry their own SHA-256, so that a bit that flips is seen.

A part has it in its name, JSON under a key, a text in a last line. A file without one is taken as
it is: a person wrote it, or an older version.
"""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text

_KEY = "sha256"
_LINE = re.compile(r"# sha256 ([0-9a-f]{64})\s*\Z")
_PART = re.compile(r"part-(\d{6})(?:-([0-9a-f]{64}))?\.parquet")


def json_with_digest(values: dict[str, Any]) -> str:
    """Return a JSON text with its digest, which opened_json checks."""
    return json.dumps(values | {_KEY: _digest_of(values)}, indent=2) + "\n"


def opened_json(path: Path) -> dict[str, Any]:
    """Return the values of a JSON file, without their digest.

    Raises:
        BadInput: it cannot be read, holds something else, or is not as it was written.
    """
    try:
        values = json.loads(given_text(path))
    except (ValueError, RecursionError):
        raise BadInput("is damaged: no JSON; take it from a copy", path) from None
    if not isinstance(values, dict):
        raise BadInput("is damaged: it holds no keys; take it from a copy", path)
    digest = values.pop(_KEY, None)
    if digest is not None and digest != _digest_of(values):
        raise BadInput("is damaged: its SHA-256 is another one; take it from a copy", path)
    return values


def text_with_digest(text: str) -> str:
    """Return a YAML text with its digest as a comment in the last line."""
    return f"{text}# sha256 {hashlib.sha256(text.encode()).hexdigest()}\n"


def check_text(path: Path) -> None:
    """Check that a text is as it was written, if it has a digest.

    Raises:
        BadInput: it cannot be read, or is not.
    """
    text = given_text(path)
    found = _LINE.search(text)
    if found and hashlib.sha256(text[: found.start()].encode()).hexdigest() != found[1]:
        raise BadInput(
            f"{path}: is damaged or was changed: its SHA-256 is another one; run the study again, "
            "or take away its last line if the change is meant"
        )


def part_name(number: int, content: bytes) -> str:
    """Return the name of a part: its number and its digest."""
    return f"part-{number:06d}-{hashlib.sha256(content).hexdigest()}.parquet"


def part_number(name: str) -> int | None:
    """Return the number of a part; None for another file."""
    found = _PART.fullmatch(name)
    return int(found[1]) if found else None


def is_valid_part(name: str, content: bytes) -> bool:
    """Return whether a part is as it was written."""
    found = _PART.fullmatch(name)
    return found is not None and found[2] in (None, hashlib.sha256(content).hexdigest())


def _digest_of(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
