"""The SBOM and the table of licences name all that the locks pin, with its hashes."""

import importlib.util
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.present import present

from .test_lock import JAZZY, LOCKS, ROOT, pins

SCRIPT = ROOT / "setup" / "bill_of_materials.py"


@pytest.fixture(scope="module")
def bill() -> Any:
    spec = present(importlib.util.spec_from_file_location("bill_of_materials", SCRIPT))
    module = importlib.util.module_from_spec(spec)
    present(spec.loader).exec_module(module)
    return module


def written(bill: Any, out: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), str(out)])
    bill.main()
    return out.read_text()


def locked() -> dict[str, tuple[str, list[str]]]:
    """Return version and hashes of all that the locks of ./flexslew pin, by name."""
    return {
        pin.name: (str(pin.specifier)[2:], hashes) for lock in LOCKS for pin, hashes in pins(lock)
    }


def test_the_sbom_holds_every_pin_with_its_hashes(
    bill: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = written(bill, tmp_path / "sbom.json", monkeypatch)
    found = json.loads(text)
    assert (found["bomFormat"], found["specVersion"]) == ("CycloneDX", "1.5")
    parts = {part["name"]: part for part in found["components"]}
    assert {
        name: (part["version"], [h["content"] for h in part["hashes"]])
        for name, part in parts.items()
    } == locked()
    references = [part["bom-ref"] for part in found["components"]]
    assert len({*references}) == len(references)
    for part in parts.values():
        assert re.fullmatch(r"pkg:pypi/[a-z0-9._-]+@[^@]+", part["purl"])
    assert written(bill, tmp_path / "again.json", monkeypatch) == text


def test_the_page_of_licences_is_that_of_the_lock(bill: Any) -> None:
    page = (ROOT / "docs" / "licences.md").read_text()
    assert {name: version for name, version, _, _ in rows(page)} == {
        name: version for name, (version, _) in locked().items()
    }
    parts = [bill.Component(n, v, (), words, tuple(locks)) for n, v, words, locks in rows(page)]
    assert page == bill.licences(parts)


def rows(page: str) -> list[tuple[str, str, str, list[str]]]:
    """Return name, version, licence and locks of each line of the table."""
    found = re.findall(r"^\| (\S+) (\S+) \| (.+) \| (.+) \|$", page, re.MULTILINE)
    return [(name, version, words, locks.split(", ")) for name, version, words, locks in found]


def test_every_licence_is_permitted_and_the_gpl_is_in_the_development_lock_alone(bill: Any) -> None:
    page = (ROOT / "docs" / "licences.md").read_text()
    of_jazzy = [(p.name, "", bill.licence_of(p.name), ["jazzy"]) for p, _ in pins(JAZZY)]
    for name, _, words, locks in (*rows(page), *of_jazzy):
        general = locks == ["develop"] and words == "GNU General Public License v3 (GPLv3)"
        assert permitted(words) or general, f"{name}: {words}"
    held = {name for name, _, words, _ in rows(page) if "GPLv3)" in words and "Lesser" not in words}
    assert held == {"mcap-ros2-support-fast", "pymcap-cli", "ros-parser", "small-mcap"}


def test_a_licence_that_is_not_on_the_list_is_not_permitted() -> None:
    for words in (
        "GPL-3.0",
        "MIT and GPL-3.0",
        "not stated",
        "GNU Affero General Public License v3",
    ):
        assert not permitted(words)
    assert permitted("BSD License or GNU General Public License (GPL)")  # a choice


def test_the_page_states_what_the_distributions_state(bill: Any) -> None:
    page = (ROOT / "docs" / "licences.md").read_text()
    for name, _, words, _ in rows(page):
        stated = bill.licence_of(name)
        assert stated in (words, bill.UNKNOWN), name  # UNKNOWN: not installed


PERMITTED = {
    "any-OSI",  # apsw: any licence that the Open Source Initiative approves
    "Apache 2.0", "Apache License 2.0", "Apache License, Version 2.0", "Apache Software License",
    "3-Clause BSD License", "Apache-2.0", "BSD", "BSD License", "BSD-2-Clause", "BSD-3-Clause",
    "BSD-2-Clause AND Apache-2.0 WITH LLVM-exception",
    "BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0",
    # casadi, of an extra: a library that is loaded, and not changed
    "GNU Lesser General Public License v3 or later (LGPLv3+)",
    "ISC", "ISC License (ISCL)", "MIT", "MIT License", "MIT-0", "MIT-CMU",
    "MPL-2.0", "MPL-2.0 AND (Apache-2.0 OR MIT)", "Mozilla Public License 2.0 (MPL 2.0)",
    "PSF-2.0", "Python Software Foundation License", "zlib License",
}  # fmt: skip


def permitted(words: str) -> bool:
    """Return whether one of the alternatives of a licence is permitted in all its parts."""
    choices = re.split(r" or | OR ", words)
    return words in PERMITTED or any(
        {*re.split(r" and | AND ", choice)} <= PERMITTED for choice in choices
    )
