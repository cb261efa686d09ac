"""The controllers that fell silent in a run, and their successors, as text."""

from collections.abc import Sequence

from flexslew_plant.events import BrakeActivated, ControllerNotReady, Event, FallbackActivated


def handover_lines(events: Sequence[Event]) -> list[str]:
    """Return the silent controllers with time and successor, and the reason if the bench has it."""
    words, reasons = [], {}
    for event in events:
        match event.what:
            case ControllerNotReady(controller=name, reason=reason):
                reasons[name] = reason
            case FallbackActivated(from_=name) | BrakeActivated(from_=name):
                why = f" ({reasons[name]})" if reasons.get(name) else ""
                words.append(f"{event.time:.2f} s: {event.message}{why}")
    return words
