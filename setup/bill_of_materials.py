"""What ./flexslew installs: `python setup/bill_of_materials.py FILE` writes SBOM or licences.

A name that ends in .json gets a CycloneDX 1.5 document with the hashes of the lock, for a release;
one that ends in .md the table of licences, which is docs/licences.md. Run it with the Python of
.venv: licences are what the installed distributions say of themselves.
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
LOCKS = ("requirements.lock.txt", "requirements.extra.lock.txt", "requirements.source.txt")
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^ ;]+)")
_HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")
_CLASSIFIER = "License :: OSI Approved :: "
_LONGEST = 60  # of a licence field that is a name and not the whole text
UNKNOWN = "not stated"


class Component(NamedTuple):
    """A distribution of the lock."""

    name: str
    version: str
    hashes: tuple[str, ...]  # SHA-256 of its wheels
    licence: str


def components() -> list[Component]:
    """Return what the locks pin, by name."""
    found = []
    for lock in LOCKS:
        for line in (ROOT / "setup" / lock).read_text().replace("\\\n", "").splitlines():
            pin = _PIN.match(line)
            if pin is not None:
                hashes = tuple(_HASH.findall(line))
                found.append(Component(pin[1], pin[2], hashes, licence_of(pin[1])))
    return sorted(found, key=lambda one: one.name.lower())


def licence_of(name: str) -> str:
    """Return the licence that an installed distribution states; UNKNOWN: none, or not installed."""
    try:
        stated = stated_licence(distribution(name))
    except PackageNotFoundError:
        return UNKNOWN
    return stated if stated != UNKNOWN else package_licence(name)


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
    """Return what the package.xml of a wheel of ROS 2 states."""
    package = name.removeprefix("ros-").replace("-", "_")
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
    rows = [f"| {p.name} | {p.version} | {p.licence.replace('|', '/')} |" for p in parts]
    return "\n".join(
        (
            "# Licences of what is installed",
            "",
            "What each distribution of the lock says of itself, written by",
            "`.venv/bin/python setup/bill_of_materials.py docs/licences.md`.",
            "",
            "| distribution | version | licence |",
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
