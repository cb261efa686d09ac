"""Write the table of docs/export_c.md: each controller of the shipped trials in C."""

import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.export.c_module import module_of
from flexslew_lab.export.compiled import CompiledModule
from flexslew_lab.export.flight_vector import controller_vector
from flexslew_lab.trial.sources import example_trials, read_trial
from flexslew_lab.trial.trial import Trial, build_controllers, law_of, plan_of_trial
from flexslew_plant.errors import BadInput

PAGE = Path(__file__).parent / "export_c.md"


def rows() -> Iterator[tuple[str, str, str, str]]:
    """Return trial, controller, law and result of each."""
    for shipped in example_trials():
        trial, source = read_trial(shipped.name)
        plan = plan_of_trial(trial, predict=False)
        for name, values in trial.controllers.items():
            yield trial.name, name, law_of(name, values or {})[0], result(trial, name, plan, source)


def result(trial: Trial, name: str, plan: Plan | None, source: str) -> str:
    """Return the difference in C, or why it is not written out."""
    try:
        module = module_of(trial, build_controllers(trial, source)[name], plan, source=source)
        with tempfile.TemporaryDirectory() as folder:
            compiled = CompiledModule(module, Path(folder))
            try:
                vector = controller_vector(trial, name, plan, source)
            except BadInput:
                return "written; never active in this trial"
            outputs = np.array([compiled.step(row) for row in vector.inputs])
        return f"{vector.error(outputs):.1e} of the peak"
    except BadInput as error:
        return "refused: " + str(error).split("cannot be written out: ")[-1].split(";")[0]


def main() -> None:
    """Write the table into the page."""
    lines = ["| trial | controller | law | in C |", "|---|---|---|---|"]
    for trial, name, law, found in rows():
        lines.append(f"| `{trial}` | `{name}` | `{law}` | {found} |")
    text = re.sub(
        r"<!-- laws -->.*<!-- end -->",
        lambda _: "\n".join(("<!-- laws -->", "", *lines, "", "<!-- end -->")),
        PAGE.read_text(encoding="utf-8"),
        flags=re.DOTALL,
    )
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
