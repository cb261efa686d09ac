"""The shards of a study joined into one folder."""

from pathlib import Path

from flexslew_lab.studies.disk import put
from flexslew_lab.studies.identity import require_same
from flexslew_lab.studies.run import flight_records, note
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study, load_study
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import Trust


def merged(paths: list[Path], out: Path, trust: Trust) -> tuple[Study, Store]:
    """Return the study and the folder that holds the trials of all others.

    Args:
        paths: of the shards, whole or not; they stay as they are.
        out: new, empty, or with a part of the same study.
        trust: which classes of the user's own its trials may name.

    Raises:
        BadInput: a folder holds no study, or another one; nothing was changed.
    """
    shards = [Store(folder) for folder in paths]
    for shard in shards:
        if shard.damaged:
            raise BadInput(
                f"{shard.folder / 'parts' / shard.damaged[0]}: is damaged; run that shard again"
            )
        require_same(shards[0].identity, shard.identity, shard.folder)
        if shard.folder.resolve() == out.resolve():
            raise BadInput(f"--out: {out} is one of the shards; choose another folder")
    whole = Store(out)
    if whole.exists:
        require_same(whole.identity, shards[0].identity, out)
    elif whole.unknown_items:
        raise BadInput(f"--out: {out} is not empty and holds no study; choose another folder")
    with whole.locked():
        whole.clean()
        if whole.exists:
            require_same(whole.identity, shards[0].identity, out)
        else:
            whole.create(shards[0].identity, shards[0].samples)
        for name in ("study.yaml", "trial.yaml", "samples.csv"):
            if (shards[0].folder / name).is_file():
                put(out / name, (shards[0].folder / name).read_bytes())
        for shard in shards:
            whole.adopt(shard)
        records = [flight_records(shard) for shard in shards]
        elapsed = sum(one.get("wall_time", 0.0) for one in records)
        flight_count = sum(one.get("flown", 0) for one in records)
        note(
            whole,
            wall_time=elapsed,
            flown=flight_count,
            trials_per_second=flight_count / elapsed if elapsed else None,
        )
        whole.write_table()
    return load_study(whole.description, trust), whole
