import os
from pathlib import Path

import pytest

from flexslew_lab.run import shared_memory
from flexslew_plant.errors import BadInput


def test_a_folder_with_room_and_a_system_without_one_are_no_obstacle(tmp_path: Path) -> None:
    shared_memory.require_shared_memory(tmp_path)
    shared_memory.require_shared_memory(tmp_path / "nowhere")


def test_a_full_one_is_named_with_what_is_free_and_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = os.statvfs(tmp_path)
    full = os.statvfs_result((state.f_bsize, 4096, 8, 1, 1, *state[5:]))
    monkeypatch.setattr(os, "statvfs", lambda folder: full)
    with pytest.raises(BadInput, match=r"4096 bytes are free, and nodes need 16384: .*--shm-size"):
        shared_memory.require_shared_memory(tmp_path)
