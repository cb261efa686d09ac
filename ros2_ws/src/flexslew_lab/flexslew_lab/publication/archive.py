"""A run as an RO-Crate 1.1, for a repository that gives it a DOI.

The crate has the trial, the log, the plan, the metrics and the report, the user's own code that
flew, the versions, the SHA-256 of every file, and how to fly the run again
(https://www.researchobject.org/ro-crate/specification/1.1/).
"""

import hashlib
import json
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from flexslew_control.message_fields import plan_of
from flexslew_control.plans.plan_file import save_plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics.from_bag import metrics_from, user_keys_of
from flexslew_lab.metrics.rows import flat, row_unit
from flexslew_lab.report.run_notes import NOTES
from flexslew_lab.trial.outputs import bag_folder, check_output_file, check_output_folder
from flexslew_lab.trial.own_code import HASH_KEY
from flexslew_plant.own_code import NO_CODE, Trust, file_of
from flexslew_plant.version import VERSION

METADATA = "ro-crate-metadata.json"
CHECKSUMS = "manifest-sha256.txt"
_CONTEXT = ["https://w3id.org/ro/crate/1.1/context", {"sha256": "https://schema.org/sha256"}]
_FORMATS = {
    ".mcap": "application/octet-stream",
    ".yaml": "application/yaml",
    ".json": "application/json",
    ".html": "text/html",
    ".md": "text/markdown",
    ".txt": "text/plain",
    ".py": "text/x-python",
}
_ABOUT = {
    "trial.yaml": "settings of the run, with every default",
    "plan.yaml": "the last plan that was flown",
    "metrics.json": "metrics of the run",
    "report.html": "report of the run, one page",
    NOTES: "note and tags of the run",
    "README.md": "what this is, and how to fly it again",
    CHECKSUMS: "SHA-256 of the files, for `sha256sum -c`",
}
_LICENCES = "https://spdx.org/licenses/"
_ORCID = re.compile(r"(.+?)\s*<(https://orcid\.org/[0-9X-]+)>")


class Statement(NamedTuple):
    """What its author states of an archive."""

    authors: Sequence[str] = ()  # names, each with `<https://orcid.org/...>` if there is one
    licence: str = ""  # identifier of SPDX, or an address; empty: none is given
    description: str = ""


def write_archive(
    run: Path,
    to: Path,
    statement: Statement | None = None,
    notify: Callable[[str], None] = lambda words: None,
    trust: Trust = NO_CODE,
) -> Path:
    """Return the archive of a run that was written: a folder, or a file if its name ends in .zip.

    Args:
        run: folder of the run, or its bag.
        to: new or empty folder, or a .zip.
        statement: authors, licence and description.
        notify: called with what the archive lacks.
        trust: classes that the log names and that may be loaded, for the metrics.

    Raises:
        BadInput: if there is no such run, or the place cannot be written.
    """
    stated = statement or Statement()
    zipped = to.suffix.lower() == ".zip"
    if zipped:
        check_output_file(to, "--to")
    else:
        check_output_folder(to, "--to", empty=True)
    bag = BagReader(bag_folder(run), trust=trust)
    if not stated.licence:
        notify("no licence is stated; repositories require one: --licence CC-BY-4.0")
    if not stated.authors:
        notify("no author is stated: --author 'Name <https://orcid.org/...>'")
    if not zipped:
        to.mkdir(parents=True, exist_ok=True)
        _fill(to, run, bag, stated, notify)
        return to
    with TemporaryDirectory() as temporary:
        folder = Path(temporary, to.stem)
        folder.mkdir()
        _fill(folder, run, bag, stated, notify)
        to.parent.mkdir(parents=True, exist_ok=True)
        packed = shutil.make_archive(str(Path(temporary, "packed")), "zip", folder)
        shutil.move(packed, to)
    return to


def _fill(
    crate: Path, run: Path, bag: BagReader, stated: Statement, notify: Callable[[str], None]
) -> None:
    """Write all files of an archive into an empty folder."""
    folder = run if run.is_dir() else run.parent
    folder = folder.parent if folder.name == "bag" else folder
    log = crate / "bag"
    log.mkdir()
    for path in sorted(bag.path.parent.iterdir()):
        if path == bag.path or path.name == "metadata.yaml":
            shutil.copy2(path, log / path.name)
    (crate / "trial.yaml").write_text(bag.trial_text, encoding="utf-8")
    metrics = metrics_from(bag)
    for name in ("metrics.json", "report.html", NOTES):
        if (folder / name).is_file():
            shutil.copy2(folder / name, crate / name)
    if bag.overview.plans:
        save_plan(plan_of(bag.overview.plans[-1], str(bag.path)), crate / "plan.yaml")
    for words in _own_code(crate, json.loads(bag.metadata.get(HASH_KEY, "{}"))):
        notify(words)
    name = folder.resolve().name
    (crate / "README.md").write_text(_readme(name, metrics, stated), encoding="utf-8")
    hashes = {path: _sha256(crate / path) for path in _files(crate)}
    lines = "".join(f"{digest}  {path}\n" for path, digest in hashes.items())
    (crate / CHECKSUMS).write_text(lines, encoding="utf-8")
    hashes[CHECKSUMS] = _sha256(crate / CHECKSUMS)
    versions = json.loads(bag.metadata.get("versions", "{}"))
    graph = [
        *_root(name, hashes, stated, _measured(bag, metrics)),
        *_file_entities(crate, hashes),
        *_flight(hashes, versions),
    ]
    text = json.dumps({"@context": _CONTEXT, "@graph": graph}, indent=2, ensure_ascii=False)
    (crate / METADATA).write_text(text + "\n", encoding="utf-8")


def _own_code(crate: Path, hashes: dict[str, str]) -> Iterator[str]:
    """Copy the files of the user's own classes that flew; yield which are not there any more."""
    for name, known in hashes.items():
        path = file_of(name)
        if path is None or _sha256(path) != known:
            yield f"{name}: its file has changed since the run, or is gone: it is left out"
            continue
        place = Path(name.rpartition(":")[0] or path.name)
        inside = not place.is_absolute() and ".." not in place.parts
        target = crate / (place if inside and ".py:" in name else Path("code", path.name))
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, target)


def _files(crate: Path) -> list[str]:
    return sorted(p.relative_to(crate).as_posix() for p in crate.rglob("*") if p.is_file())


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _root(
    name: str, hashes: dict[str, str], stated: Statement, measured: list[dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    """Yield the description of the crate, its root and its authors."""
    yield {
        "@id": METADATA,
        "@type": "CreativeWork",
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
        "about": {"@id": "./"},
    }
    people = [
        {"@id": found[2], "@type": "Person", "name": found[1]}
        if (found := _ORCID.fullmatch(author))
        else {"@id": f"#author-{number}", "@type": "Person", "name": author}
        for number, author in enumerate(stated.authors, start=1)
    ]
    licence = stated.licence if ":" in stated.licence else f"{_LICENCES}{stated.licence}"
    description = f"Simulated flight of a flexible spacecraft, flown with flexslew {VERSION}."
    yield {
        "@id": "./",
        "@type": "Dataset",
        "name": f"flexslew run {name}",
        "description": stated.description or description,
        "datePublished": datetime.now(UTC).date().isoformat(),
        "license": {"@id": licence} if stated.licence else "not stated",
        "author": [{"@id": person["@id"]} for person in people],
        "hasPart": [{"@id": path} for path in (*hashes, "bag/")],
        "mentions": [{"@id": "#flight"}],
        "variableMeasured": [{"@id": value["@id"]} for value in measured],
    }
    if stated.licence:
        yield {"@id": licence, "@type": "CreativeWork", "name": stated.licence}
    yield from people
    yield from measured


def _measured(bag: BagReader, metrics: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the metrics that are numbers, and the hash of the trajectory, as property values."""
    testbed, user_keys = bag.overview.testbed, user_keys_of(bag)
    names = testbed.joint_names if testbed is not None else ()
    units = dict(zip(names, testbed.joint_units if names else (), strict=True))
    found = []
    for name, value in flat(metrics).items():
        if name != "trajectory_hash" and (value is None or isinstance(value, str)):
            continue
        entry = {"@id": f"#{name}", "@type": "PropertyValue", "name": name, "value": value}
        unit = row_unit(name, units, user_keys)
        found.append(entry | ({"unitText": unit} if unit else {}))
    return found


def _file_entities(crate: Path, hashes: dict[str, str]) -> Iterator[dict[str, Any]]:
    """Yield every file with its size, format and hash, and the folder of the log."""
    parts = [path for path in hashes if path.startswith("bag/")]
    yield {
        "@id": "bag/",
        "@type": "Dataset",
        "name": "log of the run, as rosbag2 and Foxglove open it (MCAP)",
        "hasPart": [{"@id": path} for path in parts],
    }
    for path, digest in hashes.items():
        place = crate / path
        yield {
            "@id": path,
            "@type": "File",
            "name": _ABOUT.get(path, path),
            "contentSize": str(place.stat().st_size),
            "encodingFormat": _FORMATS.get(place.suffix, "application/octet-stream"),
            "sha256": digest,
        }


def _flight(hashes: dict[str, str], versions: dict[str, str]) -> Iterator[dict[str, Any]]:
    """Yield the flight as an action of the software, and the versions of what took part."""
    results = [path for path in hashes if path.startswith("bag/") or path == "metrics.json"]
    software = {"flexslew": VERSION} | versions
    yield {
        "@id": "#flight",
        "@type": "CreateAction",
        "name": "flight of the trial",
        "description": "flexslew trial trial.yaml --in-process",
        "object": [{"@id": "trial.yaml"}],
        "result": [{"@id": path} for path in results],
        "instrument": [{"@id": f"#software-{name}"} for name in software],
    }
    for name, version in software.items():
        yield {
            "@id": f"#software-{name}",
            "@type": "SoftwareApplication",
            "name": name,
            "version": version,
        }


def _readme(name: str, metrics: dict[str, Any], stated: Statement) -> str:
    digest = metrics.get("trajectory_hash")
    words = f"{stated.description}\n\n" if stated.description else ""
    return f"""# flexslew run {name}

{words}This folder is an RO-Crate 1.1: `{METADATA}` describes every file. `sha256sum -c {CHECKSUMS}`
checks them.

## Fly it again

With flexslew {VERSION}, in this folder:

```sh
flexslew trial trial.yaml --in-process   # the trial once more
flexslew resim .                         # the run from its log, with what an operator did
flexslew report .                        # the report from the log
```

The trajectory of the run has the SHA-256 `{digest}`; `metrics.json` of a run that is
flown again has the same under `trajectory_hash`, with the versions that `{METADATA}` lists.
"""
