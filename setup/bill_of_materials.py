"""The locked distributions: `python setup/bill_of_materials.py FILE` writes SBOM or licences.

A name that ends in .json gets a CycloneDX 1.5 document with the hashes of the lock, for a release;
one that ends in .md the table of licences, which is docs/licences.md. Run it with the Python of
.venv, after .ci/tools: licences are those that the installed distributions state.
"""

import json
import re
import sys
import tomllib
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
LOCKS = (
    "requirements.lock.txt",
    *sorted(path.name for path in (ROOT / "setup").glob("requirements.extra.*.lock.txt")),
    "requirements.source.txt",
    "requirements.develop.lock.txt",
)
# the only lock that may hold tools under the GPL; ./flexslew installs none of it
DEVELOP = LOCKS[-1]
# read in their repositories, as the distributions state none
_READ_BY_HAND = {
    "fmpy": "BSD-2-Clause",
    "ros-ament-cmake-gmock": "Apache License 2.0",
    "ros-ament-cmake-gtest": "Apache License 2.0",
    "ros-ament-cmake-pytest": "Apache License 2.0",
    "ros-ament-cmake-ros": "Apache License 2.0",
    "ros-fastcdr": "Apache License 2.0",
    "ros-fastdds": "Apache License 2.0",
    "ros-fastrtps": "Apache License 2.0",
    "ros-fastrtps-cmake-module": "Apache License 2.0",
    "ros-python-cmake-module": "Apache License 2.0",
    "setuptools": "MIT",
}
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^ ;]+)")
_HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")
_CLASSIFIER = "License :: OSI Approved :: "
_LONGEST = 60  # of a licence field that is a name and not the whole text
UNKNOWN = "not stated"


class Component(NamedTuple):
    """A distribution of the locks."""

    name: str
    version: str
    hashes: tuple[str, ...]  # SHA-256 of its wheels
    licence: str
    locks: tuple[str, ...]  # main, source, develop, or the extras that have it


def components() -> list[Component]:
    """Return the distributions of the locks, by name."""
    found: dict[str, Component] = {}
    for lock in LOCKS:
        kind = lock.removeprefix("requirements.").removeprefix("extra.").partition(".")[0]
        kind = "main" if kind == "lock" else kind
        for line in (ROOT / "setup" / lock).read_text().replace("\\\n", "").splitlines():
            pin = _PIN.match(line)
            if pin is not None:
                hashes = tuple(_HASH.findall(line))
                others = found[pin[1]].locks if pin[1] in found else ()
                licence = licence_of(pin[1])
                found[pin[1]] = Component(pin[1], pin[2], hashes, licence, (*others, kind))
    return sorted(found.values(), key=lambda one: one.name.lower())


def licence_of(name: str) -> str:
    """Return the licence of a distribution: stated, of its ROS package, or read by hand."""
    try:
        stated = stated_licence(distribution(name))
    except PackageNotFoundError:
        stated = UNKNOWN
    if stated == UNKNOWN:
        stated = package_licence(name)
    general = re.sub(r"^ros-(kilted|jazzy)-", "ros-", name)
    return stated if stated != UNKNOWN else _READ_BY_HAND.get(general, UNKNOWN)


def stated_licence(installed: Distribution) -> str:
    """Return an SPDX expression where there is one, else the classifiers, else the free field."""
    about = installed.metadata
    if about.get("License-Expression"):
        return str(about["License-Expression"])
    kinds = about.get_all("Classifier") or ()
    approved = [kind.removeprefix(_CLASSIFIER) for kind in kinds if kind.startswith(_CLASSIFIER)]
    if approved:
        return " or ".join(approved)
    free = " ".join(str(about.get("License") or "").split())
    return free if 0 < len(free) <= _LONGEST else UNKNOWN


def package_licence(name: str) -> str:
    """Return the licence that the package.xml of a wheel of ROS 2 states."""
    package = re.sub(r"^ros-(kilted-|jazzy-)?", "", name).replace("-", "_")
    path = Path(sys.prefix) / "share" / package / "package.xml"
    if not path.is_file():
        return UNKNOWN
    found = [(element.text or "").strip() for element in ElementTree.parse(path).iter("license")]
    return " and ".join(found) or UNKNOWN


def sbom(parts: list[Component]) -> dict[str, object]:
    """Return a CycloneDX 1.5 document; the same lock gives the same bytes."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": project["name"],
                "name": project["name"],
                "version": project["version"],
                "licenses": [{"license": {"id": project["license"]}}],
            }
        },
        "components": [
            {
                "type": "library",
                "scope": "excluded" if part.locks == ("develop",) else "required",
                "bom-ref": f"pkg:pypi/{part.name.lower()}@{part.version}",
                "name": part.name,
                "version": part.version,
                "purl": f"pkg:pypi/{part.name.lower()}@{part.version}",
                "hashes": [{"alg": "SHA-256", "content": digest} for digest in part.hashes],
                "licenses": []
                if part.licence == UNKNOWN
                else [{"license": {"name": part.licence}}],
            }
            for part in parts
        ],
    }


def licences(parts: list[Component]) -> str:
    """Return the table of licences as Markdown."""
    rows = [
        f"| {p.name} {p.version} | {p.licence.replace('|', '/')} | {', '.join(p.locks)} |"
        for p in parts
    ]
    return "\n".join(
        (
            "# Licences of what is installed",
            "",
            "The licence that each locked distribution states, written by",
            "`.venv/bin/python setup/bill_of_materials.py docs/licences.md`. `./flexslew` installs",
            "those of `main` and `source`, `./flexslew extras` those of the extras; `develop` has",
            "tools of CI only, some of them under the GPL.",
            "",
            "| distribution | licence | locks |",
            "|---|---|---|",
            *rows,
            "",
        )
    )


def main() -> None:
    """Write the file that the command line names."""
    out, parts = Path(sys.argv[1]), components()
    text = json.dumps(sbom(parts), indent=2) + "\n" if out.suffix == ".json" else licences(parts)
    out.write_text(text)


if __name__ == "__main__":
    main()
