"""Arguments and options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

TrialFile = Annotated[
    str | None,
    typer.Argument(help="Trial file, or the name of a shipped one (see trials); default: m1."),
]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", help="key.path=value, replaces the file's; may be repeated."),
]
Bag = Annotated[Path, typer.Argument(help="Folder of a run, a bag, or an .mcap file.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
PageFile = Annotated[Path | None, typer.Option(help="HTML file; default: a new one below runs/.")]
RunFolder = Annotated[Path | None, typer.Option(help="Folder of the run.")]
TrustOption = Annotated[
    list[str] | None,
    typer.Option(
        "--trust", help="Allow this class that is named there: file.py:Class, or all; repeatable."
    ),
]
Workers = Annotated[
    int | None, typer.Option(help="Processes here; one per core if left out.", min=1)
]
