"""The SBOM and the table of licences name all that the locks pin, with its hashes."""

import importlib.util
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from tests.present import present

from .test_lock import ROOT, pins

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
        pin.name: (str(pin.specifier)[2:], hashes)
        for lock in (
            "requirements.lock.txt",
            "requirements.extra.lock.txt",
            "requirements.source.txt",
        )
        for pin, hashes in pins(lock)
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
    rows = re.findall(r"^\| (\S+) \| (\S+) \| (.+) \|$", page, re.MULTILINE)[1:]
    assert {name: version for name, version, _ in rows} == {
        name: version for name, (version, _) in locked().items()
    }
    assert page == bill.licences([bill.Component(n, v, (), words) for n, v, words in rows])
