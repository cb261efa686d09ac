"""Write docs/benchmark/leaderboard.md and its picture: `python docs/make_leaderboard.py`.

The rows are those that come with the bench; `./flexslew benchmark baselines --out FILE` flies them.
tests/lab/benchmark/test_leaderboard.py checks that the page is current.
"""

from pathlib import Path
from typing import Any

import matplotlib as mpl

from flexslew_lab.benchmark.baselines import RESULTS, read_rows
from flexslew_lab.benchmark.leaderboard import COLUMNS, cells

mpl.use("Agg")
from matplotlib import pyplot as plt

PAGE = Path(__file__).parent / "benchmark" / "leaderboard.md"
HEAD = """# Leaderboard

Every built-in law on a task that it suits, with a planner that suits it, on all development
members. Effort is the mean of `control_effort`. Your results stand beside them in the table of
`./flexslew benchmark run`.

```sh
./flexslew benchmark baselines acc --out leaderboard.json --page leaderboard.html
```

![Score of each baseline over its effort](leaderboard.png)
"""


def page() -> str:
    """Return the page as the rows have it."""
    parts = [HEAD]
    for task, rows in by_task().items():
        lines = ["| " + " | ".join(cells(row)) + " |" for row in rows]
        head = f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}"
        parts.append("\n".join((f"## {task}", "", head, *lines, "")))
    return "\n".join(parts)


def by_task() -> dict[str, list[dict[str, Any]]]:
    """Return the rows by task."""
    rows = read_rows(RESULTS)
    return {task: [r for r in rows if r["task"] == task] for task in {r["task"]: 0 for r in rows}}


def main() -> None:
    """Write the page and the picture."""
    PAGE.write_text(page(), encoding="utf-8")
    tasks = by_task()
    figure, axes = plt.subplots(2, 3, figsize=(12.0, 9.0), layout="constrained")
    for axis, (task, rows) in zip(axes.flat, tasks.items(), strict=False):
        known = [row for row in rows if row["effort"] is not None]
        for row in known:
            label = row["entry"]["name"]
            axis.semilogx(row["effort"], row["score"]["mean"], "o", label=label)
        efforts = [row["effort"] for row in known]
        axis.set(title=task, xlabel="control effort", ylabel="score", ylim=(0.0, 100.0))
        axis.set_xlim(0.1 * min(efforts), 10.0 * max(efforts))
        axis.grid(visible=True, alpha=0.3)
        axis.legend(fontsize="x-small", loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    figure.savefig(PAGE.with_suffix(".png"), dpi=80)


if __name__ == "__main__":
    main()
