"""What a user keeps of a run beside its log: a note and tags, in one file, and the trash."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from flexslew_lab.log.files.bag_lock import LOCK_FILE
from flexslew_lab.log.files.whole_file import write_whole
from flexslew_lab.trial.outputs import bag_folder
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.processes.file_lock import lock_file
from flexslew_plant.yaml_data import load_yaml, yaml_text

NOTES = "notes.yaml"  # in the folder of a run
TRASH = ".trash"  # in the folder of the runs
_LARGE = 1 << 16  # [B]


class RunNotes(NamedTuple):
    """The note and the tags of a run."""

    note: str = ""
    tags: tuple[str, ...] = ()


def read_notes(run: Path) -> RunNotes:
    """Return the notes of a run; empty ones where it has none.

    Raises:
        BadInput: the file is not as written here.
    """
    file = run / NOTES
    if not file.exists():
        return RunNotes()
    found = load_yaml(given_text(file, _LARGE), str(file)) or {}
    tags = found.get("tags", []) if isinstance(found, dict) else None
    if not isinstance(tags, list):
        raise BadInput("is not a note with tags; correct or remove it", file)
    return RunNotes(str(found.get("note", "")), tuple(map(str, tags)))


def set_note(run: Path, note: str) -> None:
    """Replace the note of a run; an empty one removes it.

    Raises:
        BadInput: see require_run and read_notes.
    """
    _write(require_run(run), read_notes(run)._replace(note=note.strip()))


def set_tags(run: Path, tags: Sequence[str]) -> None:
    """Replace the tags of a run, each once, in their order.

    Raises:
        BadInput: see require_run and read_notes.
    """
    cleaned = dict.fromkeys(tag.strip() for tag in tags if tag.strip())
    _write(require_run(run), read_notes(run)._replace(tags=tuple(cleaned)))


def move_to_trash(run: Path) -> Path:
    """Return where a run was moved, in the trash beside it.

    Raises:
        BadInput: it is no run, it is being flown, or the trash has one of its name.
    """
    folder = require_run(run)
    bag = bag_folder(folder)
    if (bag / LOCK_FILE).exists():
        handle = lock_file(bag / LOCK_FILE, create=False)
        if handle is None:
            raise BadInput("is being flown; end the run first", run)
        os.close(handle)
    target = folder.parent / TRASH / folder.name
    if target.exists():
        raise BadInput(f"the trash has a run of this name; remove or rename {target}", run)
    target.parent.mkdir(exist_ok=True)
    folder.rename(target)
    return target


def restore(run: Path) -> Path:
    """Return the folder of a run that was moved back from the trash.

    Args:
        run: where it was.

    Raises:
        BadInput: it is not in the trash, or its place is taken.
    """
    folder = Path(os.path.abspath(run))
    source = folder.parent / TRASH / folder.name
    if not source.is_dir():
        trash = folder.parent / TRASH
        known = sorted(path.name for path in trash.iterdir()) if trash.is_dir() else []
        there = f"{', '.join(known) or 'nothing'} in {trash}"
        raise BadInput(f"is not in the trash; there is: {there}; give the path it had", run)
    if folder.exists():
        raise BadInput("its place is taken; rename what is there", run)
    source.rename(folder)
    return folder


def require_run(run: Path) -> Path:
    """Return the absolute path of a run's folder.

    Raises:
        BadInput: it is no finished run.
    """
    if not os.path.isdir(run):
        raise BadInput("no such run; ./flexslew runs lists them", run)
    if not os.path.isfile(run / "metrics.json"):
        raise BadInput("is no finished run: it has no metrics.json, or is being flown", run)
    return Path(os.path.abspath(run))


def _write(run: Path, notes: RunNotes) -> None:
    if notes == RunNotes():
        (run / NOTES).unlink(missing_ok=True)
    else:
        write_whole(run / NOTES, yaml_text({"note": notes.note, "tags": list(notes.tags)}))
