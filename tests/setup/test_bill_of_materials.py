"""The SBOM and the table of licences name all that the locks pin, with its hashes."""

import importlib.util
import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from .test_lock import ROOT, pins

SCRIPT = ROOT / "setup" / "bill_of_materials.py"


@pytest.fixture(scope="module")
def bill() -> Any:
    spec = importlib.util.spec_from_file_location("bill_of_materials", SCRIPT)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def written(bill: Any, out: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), str(out)])
    bill.main()
    return out.read_text()


def locked() -> dict[str, tuple[str, list[str]]]:
    """Return version and hashes of all that the locks of ./flexslew pin, by name."""
    return {
        pin.name: (str(pin.specifier)[2:], hashes)
        for lock in ("requirements.lock.txt", "requirements.source.txt")
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


def test_beside_an_installed_ros_each_distribution_has_a_lower_bound_no_lower_than_ours() -> None:
    lines = (ROOT / "setup" / "requirements.installed_ros.txt").read_text().splitlines()
    given = {
        canonicalize_name(r.name): r
        for r in (Requirement(line) for line in lines if line and not line.startswith("#"))
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [Requirement(line) for line in (*project["dependencies"], *extras["test"])]
    for requirement in given.values():
        assert any(part.operator in (">=", "==") for part in requirement.specifier), requirement
    for requirement in wanted:
        name = canonicalize_name(requirement.name)
        if name not in ("numpy", "pyyaml"):  # those of the installation
            assert str(given[name].specifier) == str(requirement.specifier), name
