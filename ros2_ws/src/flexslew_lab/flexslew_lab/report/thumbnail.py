"""A run as a small picture: the largest tip deflection over time, or the joints without tips."""

import numpy as np

from flexslew_lab.report.run_data import RunData

THUMBNAIL = "thumbnail.svg"  # in the folder of a run
_WIDTH, _HEIGHT, _POINTS = 140, 36, 120
_STYLE = "path{fill:none;stroke:#0b6bcb}@media(prefers-color-scheme:dark){path{stroke:#5aa9f5}}"


def thumbnail(run: RunData) -> str:
    """Return the picture as SVG; a frame without a line where nothing has moved."""
    trace = run.traces.get("tip", run.traces.get("position"))
    points = ""
    if trace is not None and np.isfinite(trace.value).any():
        time = np.nan_to_num(trace.time[:, 0])
        size = np.abs(np.nan_to_num(trace.value)).max(axis=1)
        edges = np.linspace(time[0], time[-1], _POINTS + 1)
        places = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, _POINTS - 1)
        peaks = np.zeros(_POINTS)
        np.maximum.at(peaks, places, size)
        y = _HEIGHT - 2 - (_HEIGHT - 4) * peaks / max(float(peaks.max()), 1e-300)
        x = np.linspace(1.0, _WIDTH - 1.0, _POINTS)
        points = "M" + "L".join(f"{a:.0f} {b:.1f}" for a, b in zip(x, y, strict=True))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}">'
        f'<style>{_STYLE}</style><path d="{points}"/></svg>\n'
    )
