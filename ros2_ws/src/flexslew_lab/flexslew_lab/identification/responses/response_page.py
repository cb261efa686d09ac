"""Page and numbers of modes that were fitted to frequency responses alone."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from flexslew_lab.identification.modal.modes import CONFIDENCE
from flexslew_lab.identification.page import format_interval
from flexslew_lab.identification.responses.frf_fit import ResponseModel
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Section, Table, page_of_sections

_UNITS = ("m/N", "m/(s N)", "m/(s^2 N)")


def responses_page(found: ResponseModel) -> str:
    """Return the modes and responses as HTML that needs nothing else."""
    title = found.responses.source
    return page_of_sections("identification", title, "", _sections(found), responses_verdict(found))


def responses_verdict(found: ResponseModel) -> str:
    """Return in one sentence what was found."""
    w, count = found.responses.frequency, len(found.responses.orders)
    explained = 1.0 - (np.sqrt(2.0) * found.noise / np.abs(found.responses.values).std(axis=0)) ** 2
    return (
        f"{len(found.modes)} modes between {w[0]:.4g} and {w[-1]:.4g} rad/s from "
        f"{count} frequency responses, of which {100.0 * explained.min():.4g} % or more is "
        "explained."
    )


def response_rows(found: ResponseModel) -> list[tuple[str, str]]:
    """Return the modes for a terminal."""
    return [
        (f"mode {k}, {name}", format_interval(one))
        for k, mode in enumerate(found.modes, 1)
        for name, one in (
            ("frequency [rad/s]", mode.frequency),
            ("damping ratio", mode.damping_ratio),
        )
    ]


def response_numbers(found: ResponseModel) -> dict[str, Any]:
    """Return the numbers as YAML and JSON hold them; residues are per response."""
    responses = found.responses
    names = [f"{o} per {i}" for o, i in zip(responses.outputs, responses.inputs, strict=True)]
    return {
        "source": responses.source,
        "band": [float(responses.frequency[0]), float(responses.frequency[-1])],
        "confidence": CONFIDENCE,
        "modes": [
            {
                "frequency": asdict(mode.frequency),
                "damping_ratio": asdict(mode.damping_ratio),
                "residues": dict(zip(names, row.tolist(), strict=True)),
            }
            for mode, row in zip(found.modes, found.residues, strict=True)
        ],
        "noise": dict(zip(names, found.noise.tolist(), strict=True)),
    }


def _sections(found: ResponseModel) -> Iterator[Section]:
    columns = ("mode", "frequency [rad/s]", "damping ratio")
    rows = [
        (k, format_interval(mode.frequency), format_interval(mode.damping_ratio))
        for k, mode in enumerate(found.modes, 1)
    ]
    yield Table("Modes", "± holds the truth with 95 %.", columns, rows)
    responses = found.responses
    panels, names = [], ("measured", "fitted")
    for k, order in enumerate(responses.orders):
        name = f"{responses.outputs[k]} per {responses.inputs[k]}"
        panel = Panel(name, _UNITS[order], log=True, height=200, x_title="frequency [rad/s]")
        for j, values in enumerate((responses.values[:, k], found.fitted[:, k])):
            panel.line(responses.frequency, np.abs(values), names[j], style(j))
        panels.append(panel)
    yield Group("Frequency responses", "Measured and fitted.", panels, legend(list(names)))
