"""Numbers of an imported finite element model: for a table, for JSON and in a sentence."""

from typing import Any

import numpy as np

from flexslew_lab.short_values import in_columns
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import ImportedModel

_DIRECTIONS = ("x", "y", "z", "about x", "about y", "about z")
# short: the table fits 80 columns; rx is the rotation about x
COLUMNS = (
    *("mode", "f [Hz]", "damping"),
    *(f"{name.replace('about ', 'r')} [%]" for name in _DIRECTIONS),
)


def mode_rows(found: ImportedModel) -> list[list[Any]]:
    """Return frequency, damping and effective mass of each mode, then sums and what is left out."""
    share = 100.0 * found.reduction.effective_mass
    frequencies = found.content["frequencies_hz"]
    ratios = found.content.get("damping_ratios", [0.0] * len(frequencies))
    modes = in_columns([f, z] for f, z in zip(frequencies, ratios, strict=True))
    rows = [
        [str(k + 1), *modes[k], *(f"{value:.2f}" for value in share[:, k])]
        for k in range(len(frequencies))
    ]
    total = share.sum(axis=1)
    rows.append(["all", "", "", *(f"{value:.2f}" for value in total)])
    rows.append(["left out", "", "", *(f"{value:.2f}" for value in 100.0 - total)])
    return rows


def verdict(found: ImportedModel) -> str:
    """Return what was imported in a sentence or two."""
    rigid, frequencies = found.content["rigid"], found.content["frequencies_hz"]
    centre = np.array(rigid["first_moment"]) / rigid["mass"]
    place = ", ".join(f"{c:.4g}" for c in centre)
    inertia = ", ".join(f"{i:.4g}" for i in np.diag(rigid["inertia"]))
    return (
        f"{found.model.size} degrees of freedom weigh {rigid['mass']:.4g} kg, centre {place} m "
        f"from the hinge, inertia about it {inertia} kg m^2; {len(frequencies)} clamped modes from "
        f"{frequencies[0]:.4g} to {frequencies[-1]:.4g} Hz"
    )


def plain(found: ImportedModel) -> dict[str, Any]:
    """Return the numbers as plain data."""
    reduction = found.reduction
    return {
        "degrees_of_freedom": found.model.size,
        "origin": reduction.origin.tolist(),
        "rigid": found.content["rigid"],
        "frequencies_hz": found.content["frequencies_hz"],
        "damping_ratios": found.content.get("damping_ratios"),
        "effective_mass": dict(zip(_DIRECTIONS, reduction.effective_mass.tolist(), strict=True)),
        "left_out": dict(
            zip(_DIRECTIONS, (1.0 - reduction.effective_mass.sum(axis=1)).tolist(), strict=True)
        ),
        "condition": reduction.condition,
        "residual": reduction.residual,
        "warnings": found.doubts,
    }
