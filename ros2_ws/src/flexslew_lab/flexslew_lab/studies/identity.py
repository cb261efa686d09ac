"""What a study is of, in plain data: two runs with the same identity may share one table."""

import hashlib
from contextlib import suppress
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import pyarrow as pa

from flexslew_control.plan import Plan
from flexslew_control.planners.slew import software_versions
from flexslew_control.plans.plan_file import plan_hash
from flexslew_lab.metrics import Key
from flexslew_lab.metrics.own import keys_of, load_user_metrics
from flexslew_lab.studies.flight import PlanCache
from flexslew_lab.studies.study import Study
from flexslew_lab.studies.study_settings import EXPERIMENT, MANOEUVRE
from flexslew_lab.trial.own_code import texts_in
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import file_of
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import files_of

_FILE_KEYS = ("vary", "shake", "compare")  # keys that may name files, as the trial may
_FREE = ("criteria", "keep", "limit", "trial")  # keys that change no trial
# folders with the code that determines the result of a trial
_CODE = (
    "flexslew_plant",
    "flexslew_control",
    "flexslew_lab/metrics",
    "flexslew_lab/studies/batch",
)
_IDENTIFICATION = "flexslew_lab/identification"  # decides, too, where samples are shaken
_LIBRARIES = ("pyarrow", "pydantic", "llvmlite")


def identity_of(
    study: Study, samples: pa.Table, columns: list[str], plan_cache: PlanCache
) -> dict[str, Any]:
    """Return everything that decides the table.

    Args:
        study: the file, read.
        samples: see cases.sample_table.
        columns: of the metrics.
        plan_cache: made before the first trial.
    """
    settings = plain(study.settings)
    return {
        "study": {key: value for key, value in settings.items() if key not in _FREE},
        "trial": study.base,
        "files": _files(study),
        "versions": study_versions(study),
        "plans": [
            plan_hash(p) if isinstance(p, Plan) else str(p) for p in plan_cache.made.values()
        ],
        "samples": _samples_digest(samples),
        "variants": [variant.label for variant in study.variants],
        "varied": [variable.name for variable in study.varied],
        "columns": columns,
        "keys": {name: entry._asdict() for name, entry in _user_keys(study).items()},
    }


def _user_keys(study: Study) -> dict[str, Key]:
    """Return what the keys of metrics of the trial's own hold, those of all variants."""
    found: dict[str, Key] = {}
    for one in study.nominal.values():
        names, source = one.trial.metrics, f"{study.source}: metrics"
        found |= keys_of(load_user_metrics(names, source, one.trial.trust))
    return found


def require_same(stored: dict[str, Any], here: dict[str, Any], place: Path) -> None:
    """Check that the study of a folder is the requested one.

    Raises:
        BadInput: if it is another; the message names the first difference and both values.
    """
    differences = [
        f"{key}: {_short(old)} there, {_short(new)} here"
        for key, old, new in _differences("", stored, here)
    ]
    if differences:
        more = f" (and {len(differences) - 1} more)" if len(differences) > 1 else ""
        raise BadInput(
            f"holds another study, {differences[0]}{more}; restore its settings, or "
            "choose another folder with --out",
            place,
        )


def extended(stored: dict[str, Any], here: dict[str, Any], samples: pa.Table) -> bool:
    """Return whether one study is another one with more samples, those of that come first.

    A `stop` counts checks with fewer samples, so such a study is another one.

    Args:
        stored: identity of the one.
        here: identity of the other one.
        samples: samples of the other one.
    """
    before, now = (one["study"].get("sampling") or {} for one in (stored, here))
    old, new = before.get("n"), now.get("n")
    if not (isinstance(old, int) and isinstance(new, int) and 0 < old < new):
        return False
    if here["study"].get("stop") is not None:
        return False
    first = samples.slice(0, samples.num_rows * old // new)
    extension = stored | {
        "study": stored["study"] | {"sampling": before | {"n": new}},
        "samples": here["samples"],
    }
    return extension == here and stored["samples"] == _samples_digest(first)


def require_files(study: Study, identity: dict[str, Any]) -> None:
    """Check that what trials run or read is still what it was when the study was prepared.

    Raises:
        BadInput: names the first file that has changed.
    """
    now = _files(study)
    changed = next((name for name, old in identity["files"].items() if now.get(name) != old), None)
    if changed is not None:
        words = (
            "has changed while trials flew; the newest of them are not kept: restore it and run "
            "the study again, or choose another folder with --out"
        )
        raise BadInput(words, changed)


def _differences(place: str, old: Any, new: Any) -> list[tuple[str, Any, Any]]:
    if isinstance(old, dict) and isinstance(new, dict):
        keys = [*old, *(key for key in new if key not in old)]
        inner = [_differences(f"{place}.{k}".lstrip("."), old.get(k), new.get(k)) for k in keys]
        return [found for part in inner for found in part]
    return [] if old == new else [(place, old, new)]


def _files(study: Study) -> dict[str, str]:
    """Return the digests of the files that trials run or read, by what the trials call them.

    These are classes of the user's own and data, as of modal shapes, wherever a trial, what is
    compared or a draw names one.
    """
    of_study = plain(study.settings)
    given = study.base, *(of_study[key] for key in _FILE_KEYS)
    digests = {}
    for name in sorted(set(texts_in(given))):
        with suppress(OSError, ValueError):  # of a text that could be no file's name
            if (path := file_of(name) or Path(name)).is_file():
                digests[name] = _digest([file for file in files_of(path) if file.is_file()])
            elif ".py:" in name:
                digests[name] = "missing"
    return digests


def study_versions(study: Study) -> dict[str, str]:
    """Return the versions of the libraries and the digests of the source that decide a trial."""
    found = software_versions() | {name: metadata.version(name) for name in _LIBRARIES}
    has_test = any(variant.replan in (EXPERIMENT, MANOEUVRE) for variant in study.variants)
    for folder in (*_CODE, *([_IDENTIFICATION] if has_test else [])):
        package, _, inner = folder.partition("/")
        root = Path(str(resources.files(package))) / inner
        found[f"source of {folder}"] = _digest(sorted(root.rglob("*.py")))
    return found


def _digest(paths: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _samples_digest(samples: pa.Table) -> str:
    digest = hashlib.sha256()
    for column in samples.columns:
        digest.update(repr(column.to_pylist()).encode())
    return digest.hexdigest()[:16]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
