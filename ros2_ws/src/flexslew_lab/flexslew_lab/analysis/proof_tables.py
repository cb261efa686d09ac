"""A proof as tables: for the page and for a terminal."""

from flexslew_lab.analysis.proof import DAMPING, FREQUENCY, MARGIN, Proof
from flexslew_lab.report.sections import Table

MARGIN_COLUMNS = ("effort", "margin", "predicted", "flown", "at [rad/s]", "flown at [rad/s]",
                  "agrees")  # fmt: skip
_WORDS = {True: "yes", False: "NO"}


def margin_rows(proof: Proof) -> list[tuple[str, ...]]:
    """Return a row for each margin."""
    return [
        (m.channel, m.kind, f"{m.predicted:.8g}", f"{m.flown:.8g}", f"{m.frequency:.6g}",
         f"{m.flown_frequency:.6g}", _WORDS[m.agrees])
        for m in proof.margins
    ]  # fmt: skip


def proof_tables(proof: Proof) -> list[Table]:
    """Return the tables of predictions and flights."""
    poles = [
        [f"{p.frequency:.8g}", f"{p.flown_frequency:.8g}", f"{p.damping:.6g}",
         f"{p.flown_damping:.6g}", _WORDS[p.agrees]]
        for p in proof.poles
    ]  # fmt: skip
    margin_text = (
        "The non-linear bench with a fault that multiplies or delays the effort, just inside and "
        "just outside of the margin; plant, motors and law start on the critical mode. Agrees: "
        f"it decays inside and grows outside, and the growth is zero within {100 * MARGIN:g} % of "
        "the prediction."
    )
    pole_text = (
        "The non-linear bench, started on one mode of the loop after the other. Agrees: it rings "
        f"with this one pole, its frequency within {100 * FREQUENCY:g} %, its damping within "
        f"{100 * DAMPING:g} %."
    )
    columns = ("frequency [rad/s]", "flown", "damping [-]", "flown", "agrees")
    margin_text += "".join(f" Not flown: {words}." for words in proof.skipped)
    margins = [list(row) for row in margin_rows(proof)]
    return [
        Table("Margins proved", margin_text, MARGIN_COLUMNS, margins),
        Table("Poles proved", pole_text, columns, poles),
    ]
