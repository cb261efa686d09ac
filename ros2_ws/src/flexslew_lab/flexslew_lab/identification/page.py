"""The page of an identification: verdict, modes, responses with bands, poles, whiteness."""

from collections.abc import Iterator

import numpy as np

from flexslew_lab.identification.identification import Identification
from flexslew_lab.identification.modal.modes import Interval, autocorrelation
from flexslew_lab.identification.records.record import Output
from flexslew_lab.identification.responses.frequency_response import FrequencyResponse
from flexslew_lab.report.panels import Group, Panel, legend, style
from flexslew_lab.report.sections import Section, Table, Text, page_of_sections
from flexslew_plant.counted import count_text

_MAX_POINTS = 2000  # points of a residual's curve


def identification_page(found: Identification) -> str:
    """Return the identification as HTML that needs nothing else."""
    title = found.model.record.source
    return page_of_sections("identification", title, "", _sections(found), verdict(found))


def _sections(found: Identification) -> Iterator[Section]:
    """Yield the sections of the page."""
    model, physical = found.model, found.physical
    joints = model.record.inputs
    modes = [
        (
            number,
            format_interval(mode.frequency),
            format_interval(mode.damping_ratio),
            f"{mode.periods:.0f}",
            ", ".join(
                f"{name} {value:+.2f}"
                for name, value in zip(joints, mode.participation, strict=True)
            ),
        )
        for number, mode in enumerate(model.modes, 1)
    ]
    columns = ("mode", "frequency [rad/s]", "damping ratio", "periods", "driven by")
    yield Table("Modes of the free bench", "± holds the truth with 95 %.", columns, modes)
    inertia = [
        (name, *map(format_interval, row)) for name, row in zip(joints, model.inertia, strict=False)
    ]
    yield Table("Rigid inertia", "", ("", *joints), inertia)
    if physical is not None:
        values = [(p.key, format_interval(p.value)) for p in physical.parameters]
        warnings = " ".join(physical.warnings)
        yield Table("Parameters of the bench's own equations", "", (), values, warnings)
    yield Text("No frequency responses", found.without_response)
    if found.response is not None:
        yield responses(found.response)
    yield stabilisation(found)
    yield residuals(found)
    whiteness = [
        (w.output, f"{w.statistic:.1f}", f"{w.bound:.1f}", "white" if w.white else "coloured")
        for w in model.whiteness
    ]
    yield Table("Whiteness", "", ("output", "Ljung-Box sum", "99 % bound", ""), whiteness)
    for v in found.validation:
        rows = [
            (name, f"{100.0 * part:.3f}", f"{over:.2f}")
            for name, part, over in zip(v.outputs, v.explained, v.over_noise, strict=True)
        ]
        head = ("output", "explained [%]", "residual over noise")
        yield Table("On another run", v.source, head, rows)


def summary_rows(found: Identification) -> list[tuple[str, str]]:
    """Return what was found, for a terminal."""
    model = found.model
    rows = []
    for k, mode in enumerate(model.modes, 1):
        rows.append((f"mode {k}, frequency [rad/s]", format_interval(mode.frequency)))
        words = f"{format_interval(mode.damping_ratio)} over {mode.periods:.0f} periods"
        rows.append((f"mode {k}, damping ratio", words))
    for k, (name, row) in enumerate(zip(model.record.inputs, model.inertia, strict=False)):
        rows.append((f"inertia, {name}", format_interval(row[k])))
    if found.physical is not None:
        rows += [(p.key, format_interval(p.value)) for p in found.physical.parameters]
        rows += [("warning", words) for words in found.physical.warnings]
    if found.without_response:
        rows.append(("no frequency responses", found.without_response))
    return rows


def verdict(found: Identification) -> str:
    """Return in one sentence what was found and whether to trust it."""
    model = found.model
    words = [
        f"{count_text(len(model.modes) - model.outside, 'mode')} between {model.band[0]:.3g} and "
        f"{model.band[1]:.3g} rad/s{f', {model.outside} outside,' if model.outside else ''} from "
        f"{model.record.duration:.4g} s"
    ]
    if all(w.white for w in model.whiteness):
        coloured = f"coloured noise, which intervals count with (order {model.noise_order})"
        words.append(f"what is left is {coloured if model.noise_order else 'white noise'}")
    words += model.doubts
    words += [
        f"{100.0 * float(v.explained.min()):.2f} % or more of {v.source} explained"
        for v in found.validation
    ]
    return "; ".join(words) + "."


def per_effort(response: FrequencyResponse, output: Output) -> str:
    """Return the unit of the responses of an output."""
    units = {o.name: o.unit for o in response.outputs}
    kinds = {units.get(f"position.{name}", "") for name in response.inputs}
    effort = {"rad": "N m", "m": "N"}.get(kinds.pop(), "") if len(kinds) == 1 else ""
    return f"{output.unit} per {effort or 'N m or N'}"


def responses(response: FrequencyResponse) -> Group:
    """Return magnitudes over frequency with the radius that holds the truth with 95 %."""
    panels = []
    w = response.frequency
    names: list[str] = []
    for o, output in enumerate(response.outputs):
        unit = per_effort(response, output)
        panel = Panel(output.name, unit, log=True, height=200, x_title="frequency [rad/s]")
        for i, name in enumerate(response.inputs):
            plot_style = style(i)
            size, radius = np.abs(response.response[:, o, i]), response.radius[:, o, i]
            panel.line(
                w, size, f"from {name}", plot_style, mode="lines+markers", marker={"size": 4}
            )
            for edge in (size + radius, np.maximum(size - radius, 1e-3 * size)):
                panel.line(w, edge, f"from {name}", {**plot_style, "width": 0.6, "dash": "dot"})
            if f"from {name}" not in names:
                names.append(f"from {name}")
        values = np.abs(response.response[:, o])
        panel.y_range = (float(values.min()), float(values.max()))
        panels.append(panel)
    words = (
        "From each effort to each output at the lines of the excitation; dotted: 95 % of the "
        f"truth lie between ({response.periods} periods averaged)."
    )
    return Group("Frequency responses", words, panels, legend(names))


def stabilisation(found: Identification) -> Group:
    """Return the poles of every order, and the modes that were kept as lines."""
    panel = Panel("order", height=260, x_title="frequency [rad/s]")
    names = []
    for k, poles in enumerate(found.model.starts):
        points = [(m.frequency, order) for order, ms in poles.by_order.items() for m in ms]
        band_points = [
            p for p in points if found.model.band[0] * 0.5 <= p[0] <= found.model.band[1]
        ]
        x, y = (np.array([p[axis] for p in band_points], dtype=np.float64) for axis in (0, 1))
        plot_style = {"size": 6, "color": style(k)["color"], "symbol": k}
        panel.line(x, y, poles.method, {}, mode="markers", marker=plot_style)
        names.append(poles.method)
    top = max((max(p.by_order, default=1) for p in found.model.starts), default=1)
    for mode in found.model.modes:
        w = mode.frequency.value
        panel.line(np.array([w, w]), np.array([0.0, top]), "kept", {"color": "#1d2733", "width": 1})
    return Group(
        "Stabilisation",
        "Poles by the order of the model; a mode of the bench is found again at every order. "
        "Lines: the modes that were kept and refined on the whole record.",
        [panel],
        legend(names),
    )


def residuals(found: Identification) -> Group:
    """Return the autocorrelation of every output's residual."""
    panels = []
    fit = found.model.fit
    n = len(fit.residual)
    lags = np.arange(0, 60)
    for k, output in enumerate(found.model.record.outputs):
        panel = Panel(f"{output.name}, residual {fit.noise[k]:.3g} {output.unit}", height=110)
        panel.x_title = "lag [ticks]"
        panel.line(lags.astype(float), autocorrelation(fit.residual[:, k], lags), "", style(k))
        panel.limits = (2.58 / np.sqrt(n), -2.58 / np.sqrt(n))
        panels.append(panel)
    return Group(
        "Is the residual white?",
        "Autocorrelation of what the model leaves; 99 % of white noise stays between the lines.",
        panels,
    )


def format_interval(one: Interval) -> str:
    """Return an estimate with half of its interval, for people."""
    half = 0.5 * (one.high - one.low)
    return f"{one.value:.6g} ± {half:.2g}"
