"""A chart as ECharts takes it: its axes and curves, and the rows that are new in it."""

import json
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.console.history import Curve
from flexslew_plant.arrays import Vector

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#555555", "#8a2be2")
TIME = "time [s]"
# three digits; a power of ten below 0.01 and from 1e5 on
_DIGITS = (
    "value => value === 0 ? '0' : Math.abs(value) < 1e-2 || Math.abs(value) >= 1e5"
    " ? Number(value.toPrecision(3)).toExponential() : String(Number(value.toPrecision(6)))"
)


class ChartData(NamedTuple):
    """What a chart shows."""

    options: dict[str, Any]  # what changes with the curves, and not with time
    updates: dict[str, Any]  # the window and the rows in it


def options(curves: list[Curve], title: str = TIME) -> dict[str, Any]:
    """Return the axes and the style of curves: a reference is dashed in the colour of its joint.

    Args:
        curves: curves of the chart.
        title: label below the lower axis, with quantity and unit.
    """
    series: list[dict[str, Any]] = [
        {
            "type": "line", "name": curve.label, "showSymbol": False, "silent": True,
            "connectNulls": True, "encode": {"x": "t", "y": str(k)},
            "color": COLORS[(k if curve.color is None else curve.color) % len(COLORS)],
            "lineStyle": {"width": 1.5, "type": "dashed" if curve.dashed else "solid"},
        }
        for k, curve in enumerate(curves)
    ]  # fmt: skip
    events = {
        "type": "line", "silent": True, "data": [],
        "markLine": {
            "symbol": "none", "silent": True, "label": {"show": False}, "z": 1,  # below the curves
            "lineStyle": {"color": "#999", "type": "solid", "width": 1}, "data": [],
        },
    }  # fmt: skip
    labels = [curve.label for curve in curves]
    limits = {} if curves else {"min": 0, "max": 1}  # else an empty chart has no axis
    title = title if curves else f"{title}; no data"
    description = {"description": f"chart of {', '.join(labels) or 'nothing'} over {title}"}
    small = {"fontSize": 10}
    digits = {**small, ":formatter": _DIGITS}
    return {
        "animation": False, "aria": {"enabled": True, "label": description},
        "title": {"text": title, "textStyle": {"fontSize": 11}, "left": "center", "bottom": 0},
        "grid": {"left": 58, "right": 14, "top": 34, "bottom": 36},
        "legend": {
            "top": 0, "type": "scroll", "data": labels,
            "textStyle": {"fontSize": 10}, "itemWidth": 18, "itemHeight": 8,
            "left": 4, "width": "74%",
        },
        "toolbox": {
            "right": 0, "top": 0, "itemSize": 11,
            "feature": {
                "dataZoom": {"yAxisIndex": False, "title": {"zoom": "zoom", "back": "undo"}}
            },
        },
        "tooltip": {"trigger": "axis", ":valueFormatter": _DIGITS, "textStyle": {"fontSize": 11}},
        "xAxis": {"type": "value", "axisLabel": {**small, "hideOverlap": True}},
        "yAxis": {"type": "value", "scale": True, "axisLabel": digits, "splitNumber": 4, **limits},
        "series": [*series, events],
    }  # fmt: skip


def with_log_axes(layout: dict[str, Any]) -> dict[str, Any]:
    """Return the layout of a chart with both axes logarithmic."""
    axes: dict[str, Any] = {axis: {**layout[axis], "type": "log"} for axis in ("xAxis", "yAxis")}
    axes["yAxis"].pop("scale", None)
    return {**layout, **axes}


def chart_update(axis: Vector, rows: list[Vector], events: Vector) -> dict[str, Any]:
    """Return the rows of a chart, its window exactly as wide as the axis, and lines for events."""
    source: dict[str, Any] = {"t": np.round(axis, 6).tolist()}
    for k, row in enumerate(rows):
        finite = np.isfinite(row)
        source[str(k)] = [
            v if known else None for v, known in zip(row.tolist(), finite, strict=True)
        ]
    ends = {"min": float(axis[0]), "max": float(axis[-1])} if len(axis) else {}
    lines = {"markLine": {"data": [{"xAxis": float(t)} for t in events]}}
    return {
        "dataset": {"source": source, "dimensions": list(source)},
        "xAxis": ends,
        "series": [*({} for _ in rows), lines],
    }


def full_chart(data: ChartData) -> dict[str, Any]:
    """Return all of a chart, for a browser that does not have it yet."""
    found = {**data.options, "dataset": data.updates["dataset"]}
    found["xAxis"] = {**data.options["xAxis"], **data.updates["xAxis"]}
    *series, events = data.options["series"]
    marks = {**events["markLine"], **data.updates["series"][-1]["markLine"]}
    found["series"] = [*(dict(one) for one in series), {**events, "markLine": marks}]
    return found


def expression(value: Any) -> str:
    """Return plain data in JavaScript; what a key that begins with a colon holds is code itself."""
    if isinstance(value, dict):
        pairs = (
            f"{json.dumps(key[1:])}: {part}"
            if key.startswith(":")
            else f"{json.dumps(key)}: {expression(part)}"
            for key, part in value.items()
        )
        return f"{{{', '.join(pairs)}}}"
    if isinstance(value, list) and any(isinstance(part, dict) for part in value):
        return f"[{', '.join(map(expression, value))}]"
    return json.dumps(value)
