"""How the bench stands, as text."""

import html

from flexslew_lab.console.desk import PanelContext
from flexslew_lab.console.view import BenchView


class StatePanel:
    """Run state, time, rate, ticks, misses, active controller, readiness of each or the reason.

    Args:
        context: desk of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        self._view = context.view
        self._html = context.gui.html()

    def refresh(self) -> None:
        """Show it where it changed."""
        self._html.content = _table(self._view)


def _table(view: BenchView) -> str:
    now = view.now
    rate = f"{now.rate_factor:g} times real time" if now.rate_factor else "as fast as possible"
    end = f" of {now.last_tick}" if now.last_tick else ""
    request = view.brake_request
    brake = "LATCHED until released" if now.brake_latched else "not latched"
    if request is not None:
        brake = f"{'latches' if request.on else 'is released'} at tick {request.tick}"
    elif not now.active and not now.brake_latched and now.state != "not found":
        brake = "on: no controller is active"
    period = view.joints.period if view.joints else 0.0
    tick = max(now.tick, round(view.time / period)) if period else now.tick
    rows = [
        ("state", now.state),
        ("time", f"{view.time:.2f} s"),
        ("tick", f"{tick}{end}"),
        ("rate", rate),
        ("missed ticks", str(now.missed_ticks)),
        ("in charge", now.active or "the drive's brake"),
        ("brake", brake),
    ]
    if now.waiting_for:
        rows.append(("waiting for", ", ".join(now.waiting_for)))
    for controller in sorted(view.controllers.values()):
        ready = "ready" if controller.ready else f"not ready: {controller.reason}"
        rows.append((controller.name, ready))
    body = "".join(
        f'<tr><th scope="row" style="text-align:left;font-weight:600;padding-right:0.8em;'
        f'vertical-align:top;min-width:7em;overflow-wrap:anywhere">{html.escape(name)}</th>'
        f'<td style="min-width:9em;vertical-align:top;overflow-wrap:anywhere">'
        f"{html.escape(value)}</td></tr>"
        for name, value in rows
    )
    return (
        '<table id="bench-state" aria-label="state of the bench" '
        f'style="font-size:0.85em;margin:0.3em 0.7em">{body}</table>'
    )
