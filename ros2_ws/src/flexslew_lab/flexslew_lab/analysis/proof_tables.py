"""A proof as tables: for the page and for a terminal."""

import numpy as np

from flexslew_lab.analysis.proof import DAMPING, FREQUENCY, MARGIN, Proof
from flexslew_lab.analysis.table import Table

MARGIN_COLUMNS = ("effort", "margin", "predicted", "flown", "at [rad/s]", "flown at [rad/s]",
                  "agrees")  # fmt: skip
_WORDS = {True: "yes", False: "NO", None: "not told apart"}


def margin_rows(proof: Proof) -> list[tuple[str, ...]]:
    """Return a row for each margin."""
    return [
        (m.channel, m.kind, f"{m.predicted:.8g}", f"{m.flown:.8g}", f"{m.frequency:.6g}",
         f"{m.flown_frequency:.6g}", _WORDS[m.agrees])
        for m in proof.margins
    ]  # fmt: skip


def proof_tables(proof: Proof) -> list[Table]:
    """Return what was predicted beside what was flown."""
    poles = [
        [f"{p.frequency:.8g}", _number(p.flown_frequency), f"{p.damping:.6g}",
         _number(p.flown_damping), _WORDS[p.agrees]]
        for p in proof.poles
    ]  # fmt: skip
    flown = (
        "The non-linear bench after a small push, with a fault that multiplies or delays the "
        f"effort, just inside and just outside of the margin. Agrees: within {100 * MARGIN:g} %, "
        "it decays inside and grows outside."
    )
    heard = (
        "The ring-down of the non-linear bench after a small push. Agrees: frequency within "
        f"{100 * FREQUENCY:g} %, damping within {100 * DAMPING:g} %. Poles that lie too close "
        "together are not told apart by one record."
    )
    columns = ("frequency [rad/s]", "flown", "damping [-]", "flown", "agrees")
    return [
        Table("Margins proved", flown, MARGIN_COLUMNS, [list(row) for row in margin_rows(proof)]),
        Table("Poles proved", heard, columns, poles),
    ]


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.8g}"
