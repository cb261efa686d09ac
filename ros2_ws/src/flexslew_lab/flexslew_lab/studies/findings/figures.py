"""The figures of a study: distributions, scatter, maps of the worst, sensitivities."""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from flexslew_lab.report.panels import COLOURS, GRID, LINE
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
_MAPS_PER_ROW = 5  # maps in a row
_IN_ROWS = 8  # names above a figure; more stand to its right
_ABOVE = {"orientation": "h", "yanchor": "bottom", "y": 1.0, "xanchor": "left", "x": 0.0}
_AXIS: dict[str, Any] = {"gridcolor": GRID, "linecolor": GRID, "zeroline": False}


def columns(study: Study, store: Store, name: str) -> dict[str, Vector]:
    """Return a metric by variant, failures as inf, without the trials that have no such number."""
    found = {}
    for k, variant in enumerate(study.variants):
        values = column(study, store, name, k)[0].values
        found[variant.label] = values[~np.isnan(values)]
    return found


def distribution(
    study: Study, store: Store, name: str, unit: str, each: dict[str, Vector]
) -> go.Figure:
    """Return the empirical distributions, with a DKW band where the samples are independent."""
    figure = distribution_figure(each, name, unit)
    if METHODS[study.settings.sampling.method].independent:
        confidence = joint_confidence(study, store.samples, CONFIDENCE)
        for number, values in enumerate(each.values()):
            _band(figure, values, COLOURS[number % len(COLOURS)], confidence)
    criterion = study.settings.criteria.get(name)
    if criterion is not None:
        limit = criterion.below if criterion.below is not None else criterion.above
        figure.add_vline(x=limit, line={"color": LINE, "width": 1, "dash": "dot"})
    return figure


def distribution_figure(each: dict[str, Vector], name: str, unit: str) -> go.Figure:
    """Return empirical distributions by label; a curve that ends below 1 has failures."""
    figure = go.Figure()
    for number, (label, values) in enumerate(each.items()):
        x, share = _steps(values)
        figure.add_trace(
            go.Scatter(
                x=x,
                y=share,
                mode="lines",
                name=label or name,
                line={"color": COLOURS[number % len(COLOURS)], "shape": "hv", "width": 1.8},
                hovertemplate="%{x:.4g}: %{y:.4f}",
            )
        )
    figure.update_xaxes(title_text=f"{name} [{unit}]")
    figure.update_yaxes(title_text="share of trials up to x", range=[0.0, 1.02])
    return _finished(figure, max(380, 20 * len(each)))


def scatter(study: Study, store: Store, name: str, unit: str) -> go.Figure:
    """Return the metric against each varied value; failed trials as crosses at the top."""
    names = [v.name for v in study.varied][:_MAX_VARIABLES]
    column_count = min(len(names), 3)
    figure = make_subplots(
        rows=-(-len(names) // column_count),
        cols=column_count,
        shared_yaxes=True,
        horizontal_spacing=0.03,
    )
    for k, variant in enumerate(study.variants):
        found, rows = column(study, store, name, k)
        most = max(_POINTS // len(study.variants), _MINIMUM_POINTS)
        count = len(found.values)  # none before the first of its trials
        thin = np.unique(np.linspace(0, count - 1, most).astype(int))[:count]
        top = found.values[np.isfinite(found.values)].max(initial=0.0)
        values = found.values[thin]
        failed = np.isinf(values)
        table = store.table(["index", *names])
        places = np.searchsorted(table["index"].to_numpy(), rows["index"].to_numpy()[thin])
        for j, variable in enumerate(names):
            figure.add_trace(
                go.Scatter(
                    x=np.asarray(table[variable].to_pylist())[places],
                    y=np.where(failed, top, values),
                    mode="markers",
                    name=variant.label or name,
                    legendgroup=variant.label,
                    showlegend=j == 0 and len(study.variants) > 1,
                    marker={
                        "color": COLOURS[k % len(COLOURS)],
                        "size": 4,
                        "opacity": 0.55,
                        "symbol": np.where(failed, "x", "circle"),
                    },
                    text=found.numbers[thin],
                    hovertemplate="trial %{text}<br>%{x:.5g}: %{y:.5g}",
                ),
                row=1 + j // column_count,
                col=1 + j % column_count,
            )
            title = axis_title(study, variable)
            figure.update_xaxes(
                title_text=title, row=1 + j // column_count, col=1 + j % column_count
            )
    figure.update_yaxes(title_text=f"{name} [{unit}]", col=1)
    tall = 330 * -(-len(names) // column_count)
    return _finished(figure, max(tall, 20 * len(study.variants)))


def axis_title(study: Study, name: str) -> str:
    """Return a varied value with what its numbers are: drawn as a share, as an offset, or whole."""
    reference = next(v.reference for v in study.varied if v.name == name)
    return {"relative": f"{name}, relative error [-]", "offset": f"{name}, offset"}.get(
        reference, name
    )


def maps(study: Study, store: Store, name: str, unit: str) -> list[go.Figure]:
    """Return worst and 99 % of the metric over the first two varied values.

    One figure each, all variants side by side with the same colours.
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
    rules = {"worst": np.max, "99 %": lambda v: quantile(v, 0.99)}
    return [
        _map_of_all(
            [(label, _cells(x, y, values, rule)) for label, x, y, values in found],
            f"{name}, {title}",
            [axis_title(study, n) for n in names],
            unit,
        )
        for title, rule in rules.items()
    ]


def _map_of_all(
    variant_maps: list[tuple[str, tuple[Vector, Vector, Matrix]]],
    title: str,
    names: list[str],
    unit: str,
) -> go.Figure:
    """Return one map per variant, failures as crosses."""
    column_count = min(len(variant_maps), _MAPS_PER_ROW)
    tall = -(-len(variant_maps) // column_count)
    figure = make_subplots(
        rows=tall,
        cols=column_count,
        subplot_titles=[
            label.replace(", ", "<br>") for label, _ in variant_maps
        ],  # narrow, not to touch
        shared_xaxes=True,
        shared_yaxes=True,
        horizontal_spacing=0.02,
        vertical_spacing=0.3 / tall if tall > 1 else 0.0,
    )
    for k, (_, (column_values, up, cells)) in enumerate(variant_maps):
        place = {"row": 1 + k // column_count, "col": 1 + k % column_count}
        figure.add_trace(
            go.Heatmap(
                x=column_values,
                y=up,
                z=np.where(np.isinf(cells), np.nan, cells),
                coloraxis="coloraxis",
                hovertemplate="%{x:.4g}, %{y:.4g}: %{z:.5g}<extra></extra>",
            ),
            **place,
        )
        bad = np.argwhere(np.isinf(cells))
        figure.add_trace(
            go.Scatter(
                x=column_values[bad[:, 1]],
                y=up[bad[:, 0]],
                mode="markers",
                marker={"symbol": "x", "color": "#c2375f", "size": 7},
                showlegend=False,
                hovertemplate="failed<extra></extra>",
            ),
            **place,
        )
    figure.update_xaxes(title_text=names[0], row=tall, col=1 + (column_count - 1) // 2)
    figure.update_yaxes(title_text=names[1], row=1 + (tall - 1) // 2, col=1)
    scale = {"colorscale": "Viridis", "colorbar": {"title": f"[{unit}]"}}
    figure.update_layout(title_text=title, coloraxis=scale)
    figure.update_annotations(font_size=11)
    return _finished(figure, 400 if tall == 1 else 120 + 190 * tall).update_layout(margin_t=90)


def sensitivity(line: dict[str, Any]) -> go.Figure:
    """Return first-order and total indices with their bounds."""
    figure = go.Figure()
    names = list(line["indices"])
    for number, kind in enumerate(("first", "total")):
        low, middle, high = np.array([line["indices"][n][kind] for n in names]).T
        figure.add_trace(
            go.Bar(
                x=names,
                y=middle,
                name=kind,
                marker={"color": COLOURS[number]},
                error_y={"type": "data", "array": high - middle, "arrayminus": middle - low},
            )
        )
    figure.update_yaxes(title_text="share of the variance")
    return _finished(figure, 340)


def _steps(values: Vector) -> tuple[Vector, Vector]:
    """Return the steps of an empirical distribution, thinned; its height counts failures too."""
    ordered = np.sort(values)
    share = np.arange(1, len(ordered) + 1) / max(len(ordered), 1)
    finite = int(np.isfinite(ordered).sum())
    thin = np.unique(np.linspace(0, max(finite - 1, 0), min(finite, _POINTS)).astype(int))
    thin = thin[:finite]
    return ordered[thin], share[thin]


def _band(figure: go.Figure, values: Vector, colour: str, confidence: float) -> None:
    if not len(values):
        return
    x, share = _steps(values)
    width = dkw_half_width(len(values), confidence)
    for side in (-1.0, 1.0):
        figure.add_trace(
            go.Scatter(
                x=x,
                y=np.clip(share + side * width, 0.0, 1.0),
                mode="lines",
                line={"color": colour, "width": 0.8, "dash": "dot", "shape": "hv"},
                showlegend=False,
                hoverinfo="skip",
            )
        )


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


def _finished(figure: go.Figure, height: int) -> go.Figure:
    figure.update_xaxes(**_AXIS)
    figure.update_yaxes(**_AXIS)
    figure.update_layout(
        height=height,
        margin={"l": 70, "r": 20, "t": 50, "b": 50},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        font={"family": "Inter, system-ui, sans-serif", "size": 12, "color": LINE},
        legend=_ABOVE if len({t.name for t in figure.data}) <= _IN_ROWS else {"y": 1.0},
        modebar={"bgcolor": "rgba(0,0,0,0)", "orientation": "v"},
    )
    return figure
