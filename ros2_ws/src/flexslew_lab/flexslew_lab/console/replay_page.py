"""The same page over the log of a run."""

from collections.abc import Callable
from pathlib import Path
from threading import Event

from flexslew_lab.console.page import Page
from flexslew_lab.console.replay import Replay
from flexslew_plant.own_code import NO_CODE, Trust


def serve(
    bag: Path,
    host: str,
    port: int,
    notify: Callable[[str], None],
    trust: Trust = NO_CODE,
    browser: bool = False,
) -> None:
    """Serve a page over a log until interrupted.

    Args:
        bag: folder or file of the log.
        host: address to listen on.
        port: 0 takes any.
        notify: called with the address of the page.
        trust: testbeds of the user's own that are drawn.
        browser: open the page where there is a screen.

    Raises:
        BadInput: the bag cannot be read, or the port cannot be opened.
    """
    link = Replay(bag, trust)
    page = Page(link, host, port, notify, link)
    if browser:
        page.server.open_browser()
    page.serve(Event())  # which never comes
