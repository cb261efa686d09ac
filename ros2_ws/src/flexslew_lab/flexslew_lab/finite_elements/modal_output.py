"""Modal data as a file."""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_lab.log.files.whole_file import write_whole
from flexslew_plant.yaml_data import yaml_text


def write_modal_data(content: dict[str, Any], path: Path) -> None:
    """Write modal data whole or not at all.

    Args:
        content: by the keys of `modal_file`.
        path: ends in .npz, else it is YAML.

    Raises:
        BadInput, OSError: see write_whole.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix != ".npz":
        write_whole(path, yaml_text(content))
        return
    flat = {key: value for key, value in content.items() if key != "rigid"}
    flat |= {f"rigid_{key}": value for key, value in content["rigid"].items()}
    archive = BytesIO()
    np.savez_compressed(archive, **flat)
    write_whole(path, archive.getvalue())
