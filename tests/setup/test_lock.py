"""The locks: exact versions with hashes, no place to fetch from, all that the project asks for."""

import re
import tomllib
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCKS = ("requirements.lock.txt", "requirements.develop.lock.txt", "requirements.source.txt")


def pins(name: str) -> list[tuple[Requirement, list[str]]]:
    """Return the requirements of a lock with their hashes."""
    text = (ROOT / "setup" / name).read_text().replace("\\\n", "")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return [
        (Requirement(line.split("--hash")[0]), re.findall(r"--hash=sha256:([0-9a-f]{64})\b", line))
        for line in lines
    ]


@pytest.mark.parametrize("name", LOCKS)
def test_each_distribution_is_pinned_once_and_has_a_hash(name: str) -> None:
    found = pins(name)
    assert found
    assert len({canonicalize_name(pin.name) for pin, _ in found}) == len(found)
    for pin, hashes in found:
        assert re.fullmatch(r"==[0-9][^*,]*", str(pin.specifier)), pin
        assert hashes, pin


@pytest.mark.parametrize("name", [*LOCKS, "requirements.installed_ros.txt"])
def test_no_lock_says_where_to_fetch_from(name: str) -> None:
    text = (ROOT / "setup" / name).read_text()
    assert "://" not in text
    assert [line for line in text.splitlines() if line.startswith("-")] == []


def test_the_lock_satisfies_the_project_and_its_extras() -> None:
    versions = {
        canonicalize_name(pin.name): str(pin.specifier)[2:]
        for name in LOCKS[:2]
        for pin, _ in pins(name)
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    for line in chain(project["dependencies"], *extras):
        requirement = Requirement(line)
        if canonicalize_name(requirement.name) == "matplotlib":  # docs/make_picture.py alone
            continue
        version = versions[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), line


def test_nothing_stands_in_two_locks() -> None:
    names = [[canonicalize_name(pin.name) for pin, _ in pins(lock)] for lock in LOCKS]
    flat = [name for lock in names for name in lock]
    assert len(set(flat)) == len(flat)
