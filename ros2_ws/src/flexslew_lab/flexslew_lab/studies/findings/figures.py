"""The figures of a study: distributions, scatter, maps of the worst, sensitivities."""

from typing import Any

import numpy as np

from flexslew_lab.report.panels import COLOURS, FAULT, LINE, Group, Panel, legend, style
from flexslew_lab.studies.findings.columns import CONFIDENCE, column
from flexslew_lab.studies.findings.statistics import dkw_half_width, quantile
from flexslew_lab.studies.findings.stopping import joint_confidence
from flexslew_lab.studies.sampling.methods import METHODS
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.arrays import Matrix, Vector

_POINTS = 2000  # of a curve or of all clouds, at most
_MINIMUM_POINTS = 100  # of the cloud of a variant
_CELLS = 12  # of a map, along each side
_MAX_VARIABLES = 8  # varied values that are drawn
_TOP = 1.02  # of the axis of shares
_SHARES = "Share of trials that stay below; a curve that ends below 1 has failures."


def columns(study: Study, store: Store, name: str) -> dict[str, Vector]:
    """Return a metric by variant, failures as inf, without the trials that have no such number."""
    found = {}
    for k, variant in enumerate(study.variants):
        values = column(study, store, name, k)[0].values
        found[variant.label] = values[~np.isnan(values)]
    return found


def distribution(
    study: Study, store: Store, name: str, unit: str, each: dict[str, Vector]
) -> Group:
    """Return the empirical distributions, with a DKW band where the samples are independent."""
    group = distributions(each, name, unit)
    panel = group.panels[0]
    if METHODS[study.settings.sampling.method].independent:
        group.words += " Dotted: the band that holds the true curve at 90 % (DKW)."
        confidence = joint_confidence(study, store.samples, CONFIDENCE)
        for number, (label, values) in enumerate(each.items()):
            x, share = _steps(values)
            width = dkw_half_width(len(values), confidence) if len(values) else 0.0
            line = {**style(number), "width": 0.8, "dash": "dot", "shape": "hv"}
            for edge in (share - width, share + width):
                panel.line(x, np.clip(edge, 0.0, 1.0), label or name, line, hoverinfo="skip")
    else:
        group.words += " No band: these samples are not independent."
    criterion = study.settings.criteria.get(name)
    if criterion is not None:
        limit = criterion.below if criterion.below is not None else criterion.above
        line = {"color": LINE, "width": 1, "dash": "dot"}
        edge = np.array([0.0, _TOP])
        panel.line(np.full(2, limit), edge, "criterion", line, hoverinfo="skip")
    return group


def distributions(each: dict[str, Vector], name: str, unit: str) -> Group:
    """Return empirical distributions by label; a curve that ends below 1 has failures."""
    panel = Panel("share of trials up to x", x_title=f"{name} [{unit}]", height=340, single=True)
    panel.y_range = (0.0, _TOP)
    for number, (label, values) in enumerate(each.items()):
        line = {**style(number), "shape": "hv", "width": 1.8}
        hover = "%{x:.4g}: %{y:.4f}"
        panel.line(*_steps(values), label or name, line, hovertemplate=hover)
    return Group(name, _SHARES, [panel], legend([label or name for label in each]))


def scatter(study: Study, store: Store, name: str, unit: str) -> Group:
    """Return the metric against each varied value; failed trials as crosses at the top."""
    names = [v.name for v in study.varied][:_MAX_VARIABLES]
    panels = [
        Panel(name, unit, x_title=axis_title(study, variable), height=300, single=True)
        for variable in names
    ]
    table = store.table(["index", *names])
    most = max(_POINTS // len(study.variants), _MINIMUM_POINTS)
    for k, variant in enumerate(study.variants):
        found, rows = column(study, store, name, k)
        count = len(found.values)  # none before the first of its trials
        thin = np.unique(np.linspace(0, count - 1, most).astype(int))[:count]
        top = found.values[np.isfinite(found.values)].max(initial=0.0)
        failed = np.isinf(found.values[thin])
        places = np.searchsorted(table["index"].to_numpy(), rows["index"].to_numpy()[thin])
        symbols = np.where(failed, "x", "circle").tolist()
        points = {
            "mode": "markers",
            "marker": {"color": style(k)["color"], "size": 4, "opacity": 0.55, "symbol": symbols},
            "text": found.numbers[thin].tolist(),
            "hovertemplate": "trial %{text}<br>%{x:.5g}: %{y:.5g}",
        }
        y = np.where(failed, top, found.values[thin])
        for panel, variable in zip(panels, names, strict=True):
            x = np.asarray(table[variable].to_pylist())[places]
            panel.line(x, y, variant.label or name, {}, **points)
    labels = [variant.label for variant in study.variants] if len(study.variants) > 1 else []
    title = f"{name} against each varied value"
    return Group(title, "Crosses: failed trials.", panels, legend(labels), side_by_side=True)


def axis_title(study: Study, name: str) -> str:
    """Return a varied value with what its numbers are: drawn as a share, as an offset, or whole."""
    reference = next(v.reference for v in study.varied if v.name == name)
    return {"relative": f"{name}, relative error [-]", "offset": f"{name}, offset"}.get(
        reference, name
    )


def maps(study: Study, store: Store, name: str, unit: str) -> list[Group]:
    """Return worst and 99 % of the metric over the first two varied values.

    One group each, all variants side by side with the same colours.
    """
    names = [v.name for v in study.varied if _numeric(store, v.name)][:2]
    if len(names) < 2:
        return []
    table = store.table(["index", *names])
    found = []
    for k, variant in enumerate(study.variants):
        values, rows = column(study, store, name, k)
        places = np.searchsorted(table["index"].to_numpy(), rows["index"].to_numpy())
        x, y = (table[n].to_numpy().astype(float)[places] for n in names)
        valid = ~np.isnan(values.values)
        found.append((variant.label or name, x[valid], y[valid], values.values[valid]))
    titles = [axis_title(study, n) for n in names]
    rules = {"worst": np.max, "99 %": lambda v: quantile(v, 0.99)}
    return [
        _maps(f"{name}, {title}", titles, unit, {f[0]: _cells(*f[1:], rule) for f in found})
        for title, rule in rules.items()
    ]


def _maps(
    title: str, axes: list[str], unit: str, cells: dict[str, tuple[Vector, Vector, Matrix]]
) -> Group:
    """Return one map per variant, failures as crosses."""
    finite = np.concatenate([z[np.isfinite(z)] for _, _, z in cells.values()])
    scale = {"zmin": float(finite.min()), "zmax": float(finite.max())} if finite.size else {}
    panels = []
    for label, (x, y, z) in cells.items():
        panel = Panel(label, x_title=axes[0], height=300, single=True)
        bad, heights = np.argwhere(np.isinf(z)), z.astype(object)
        heights[~np.isfinite(z)] = None
        panel.traces.append(
            {
                "type": "heatmap",
                "x": x.tolist(),
                "y": y.tolist(),
                "z": heights.tolist(),
                "colorscale": "Viridis",
                "colorbar": {"title": {"text": f"[{unit}]"}, "thickness": 12},
                "hovertemplate": "%{x:.4g}, %{y:.4g}: %{z:.5g}<extra></extra>",
                **scale,
            }
        )
        cross = {"symbol": "x", "color": FAULT, "size": 7}
        hover = "failed<extra></extra>"
        panel.line(x[bad[:, 1]], y[bad[:, 0]], "failed", {}, mode="markers", marker=cross,
                   hovertemplate=hover)  # fmt: skip
        panels.append(panel)
    words = f"{axes[1]} is upwards. Crosses: failed trials."
    return Group(title, words, panels, side_by_side=True)


def sensitivity(line: dict[str, Any]) -> Group:
    """Return first-order and total indices with their bounds."""
    panel = Panel("share of the variance", height=300)
    names = list(line["indices"])
    kinds = ("first", "total")
    for number, kind in enumerate(kinds):
        low, middle, high = np.array([line["indices"][n][kind] for n in names]).T
        error = {"type": "data", "array": (high - middle).tolist()}
        error["arrayminus"] = (middle - low).tolist()
        panel.traces.append(
            {
                "type": "bar",
                "x": names,
                "y": middle.tolist(),
                "name": kind,
                "marker": {"color": COLOURS[number]},
                "error_y": error,
            }
        )
    words = "Sobol indices with bootstrap bounds at 90 %: alone, and with all interactions."
    return Group(sensitivity_title(line), words, [panel], legend(kinds))


def sensitivity_title(line: dict[str, Any]) -> str:
    """Return the heading of the sensitivities of a metric and variant."""
    variant = f": {line['variant']}" if line["variant"] else ""
    return f"What {line['metric']} depends on{variant}"


def _steps(values: Vector) -> tuple[Vector, Vector]:
    """Return the steps of an empirical distribution, thinned; its height counts failures too."""
    ordered = np.sort(values)
    share = np.arange(1, len(ordered) + 1) / max(len(ordered), 1)
    finite = int(np.isfinite(ordered).sum())
    thin = np.unique(np.linspace(0, max(finite - 1, 0), min(finite, _POINTS)).astype(int))
    thin = thin[:finite]
    return ordered[thin], share[thin]


def _cells(x: Vector, y: Vector, values: Vector, rule: Any) -> tuple[Vector, Vector, Matrix]:
    """Return the centres of a grid and what the rule makes of the values in each cell."""
    axes, places = [], []
    for each in (x, y):
        levels = np.unique(each)
        if len(levels) <= _CELLS:  # a grid, or a choice
            axes.append(levels)
            places.append(np.searchsorted(levels, each))
            continue
        edges = np.linspace(each.min(), each.max(), _CELLS + 1)
        axes.append(0.5 * (edges[1:] + edges[:-1]))
        places.append(np.clip(np.searchsorted(edges, each, "right") - 1, 0, _CELLS - 1))
    cells = np.full((len(axes[1]), len(axes[0])), np.nan)
    for i in range(len(axes[1])):
        for j in range(len(axes[0])):
            cell_values = values[(places[0] == j) & (places[1] == i)]
            if len(cell_values):
                cells[i, j] = rule(cell_values)
    return axes[0], axes[1], cells


def _numeric(store: Store, name: str) -> bool:
    return bool(np.issubdtype(store.samples[name].to_numpy().dtype, np.number))
