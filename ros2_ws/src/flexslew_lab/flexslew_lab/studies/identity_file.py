"""The file with the identity of the study of a folder; read without the reader of its tables."""

import os
from pathlib import Path
from typing import Any, NamedTuple

from flexslew_lab.studies.seals import json_with_digest, opened_json
from flexslew_plant.errors import BadInput

IDENTITY = "study.json"
_SHAPE: dict[str, type] = {"study": dict, "variants": list, "varied": list, "columns": list}
_DIGEST = "samples_sha256"


class KeptIdentity(NamedTuple):
    """The identity of the study of a folder."""

    identity: dict[str, Any]  # see identity.identity_of
    samples_sha256: str | None  # None: an older folder


def kept_identity(folder: Path) -> KeptIdentity:
    """Return what the study of a folder is of.

    Raises:
        BadInput: the folder holds no study, or that file is damaged.
    """
    path = folder / IDENTITY
    if not os.path.isfile(path):
        raise BadInput("holds no study", folder)
    found = opened_json(path)
    digest = found.pop(_DIGEST, None)
    for key, kind in _SHAPE.items():
        if not isinstance(found.get(key), kind):
            raise BadInput("is missing or of no use", path, key)
    return KeptIdentity(found, digest)


def identity_text(kept: KeptIdentity) -> str:
    """Return the content of that file."""
    return json_with_digest(kept.identity | {_DIGEST: kept.samples_sha256})
