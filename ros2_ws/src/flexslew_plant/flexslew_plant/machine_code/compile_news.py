"""Listeners of compilations of machine code. It loads no compiler itself."""

from collections.abc import Callable

_listeners: list[Callable[[str], None]] = []


def add_compile_listener(listener: Callable[[str], None]) -> None:
    """Call a listener with the name of every function of this process before it is compiled."""
    _listeners.append(listener)


def notify_compile(name: str) -> None:
    """Call the listeners with the name of a function that is compiled now."""
    for listener in _listeners:
        listener(name)
