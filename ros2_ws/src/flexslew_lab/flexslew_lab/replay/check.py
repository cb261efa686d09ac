"""Recorded measurements into a controller: is every number that it says the recorded one?"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers.controller import Answer, Controller
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.cdr import decode
from flexslew_lab.replay.answers import FIELDS as FIELDS
from flexslew_lab.replay.answers import Divergence as Divergence
from flexslew_lab.replay.answers import Pairs
from flexslew_lab.replay.answers import Row as Row
from flexslew_lab.replay.logged_controllers import LoggedControllers, logged_laws
from flexslew_plant.bench.measurement import Measurement
from flexslew_plant.errors import BadInput


class Check(NamedTuple):
    """A controller beside its log."""

    controller: str
    law: str
    ok: bool  # no number is another one, no recorded answer is missing
    ticks: int  # compared
    only_recorded: int  # ticks that only the log answers
    only_ours: int  # ticks that only the controller here answers: the other one was not heard
    first_divergence: Divergence | None
    rows: tuple[Row, ...]
    curves: dict[str, tuple[np.ndarray, np.ndarray]]  # field: time [s], largest |difference|


def check(
    bag: Path,
    controller: str,
    law: str | None = None,
    settings: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], None] = lambda tick, last: None,
) -> Check:
    """Return how a controller answers the measurements of a log, field by field.

    Args:
        bag: the bag's folder or file.
        controller: its name in the log.
        law: that stands in for the recorded one, with its own defaults.
        settings: that replace the recorded ones key by key.
        progress: called with the tick and the last tick.

    Raises:
        BadInput: the controller is not in the log, or the law cannot be built.
    """
    reader = BagReader(bag)
    laws = logged_laws(reader)
    if controller not in laws:
        raise BadInput(f"{reader.path}: no controller {controller}; it has {', '.join(laws)}")
    recorded_law, values = laws[controller]
    own = {} if law is not None and law != recorded_law else values
    chosen = law or recorded_law, {**own, **(settings or {})}
    logged = LoggedControllers(reader, only=controller, replaced={controller: chosen})
    pairs = Pairs(float(reader.overview.testbed.period))
    last = reader.overview.counts.get("/measurement", 0)
    for topic, kind, _, _, data in reader.messages(("/measurement", "/controller_state")):
        message = decode(kind, data)
        key = int(message.epoch), int(message.tick)
        if topic == "/controller_state":
            if message.controller == controller:
                pairs.recorded(key, {name: getattr(message, name) for name in FIELDS})
            continue
        logged.until(key)
        answer = _observe(logged.by_name[controller], message, pairs.period)
        if answer is not None:
            pairs.ours(key, _outputs(answer))
        if message.tick % 1000 == 0:
            progress(int(message.tick), last)
    pairs.finish()
    if not pairs.ticks and not pairs.only_recorded:
        raise BadInput(f"{reader.path}: {controller} has not answered in this log")
    ok = pairs.first is None
    rows = tuple(pairs.rows[name].row() for name in FIELDS)
    curves = {name: pairs.rows[name].curve.points() for name in FIELDS if pairs.rows[name].ticks}
    return Check(
        controller, chosen[0], ok, pairs.ticks, pairs.only_recorded, pairs.only_ours,
        pairs.first, rows, curves,
    )  # fmt: skip


def difference_figure(result: Check) -> Any:
    """Return the largest difference of every field over time, a plotly figure."""
    import plotly.graph_objects as go

    figure = go.Figure()
    for name, (time, value) in result.curves.items():
        if value.any():
            figure.add_scatter(x=time, y=np.where(value > 0.0, value, np.nan), name=name)
    if not figure.data:
        figure.add_annotation(text="no difference", showarrow=False, xref="paper", yref="paper")
    figure.update_layout(
        title_text=f"{result.controller} ({result.law}): |recorded - here|",
        xaxis_title="time [s]",
        yaxis={"type": "log", "title": "unit of the field", "exponentformat": "power"},
        template="plotly_white",
    )
    return figure


def _observe(controller: Controller, m: Any, period: float) -> Answer | None:
    return controller.observe(
        Measurement(
            int(m.tick),
            int(m.epoch),
            int(m.tick) * period,
            m.controller,
            m.joint_position,
            m.joint_velocity,
            m.tip_deflection,
            m.root_curvature,
            m.applied_effort,
        )
    )


def _outputs(answer: Answer) -> dict[str, Any]:
    """Return what the controller's node would publish on controller_state."""
    command, reference, estimate, terms = answer
    return {
        "reference_position": reference.position,
        "reference_velocity": reference.velocity,
        "feedforward": reference.effort,
        "estimate_position": estimate.position,
        "estimate_velocity": estimate.velocity,
        "estimate_disturbance": estimate.disturbance,
        "covariance_diagonal": np.diagonal(estimate.covariance),
        "innovation": estimate.innovation,
        "nis": estimate.nis,
        "effort": command.effort,
        "term_names": list(terms),
        "terms": np.concatenate([*terms.values(), np.zeros(0)]),
    }
