"""The `console` node: a page in the browser over the bench as it runs."""

import os
from collections.abc import Callable
from functools import partial
from typing import Annotated

from pydantic import Field

from flexslew_lab.console.page import Page
from flexslew_lab.ros.live_link import LiveLink
from flexslew_plant.own_code import Trust
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.node_process import namespace_arguments, run_node
from flexslew_plant.ros.parameters import new_node, settings_of
from flexslew_plant.settings import section

_NICE = 10  # the bench comes first


@section
class ConsoleSettings:
    """The parameters of the node."""

    host: str = "127.0.0.1"  # address to listen on
    port: Annotated[int, Field(ge=0, le=65535)] = 8080  # 0: any free one
    browser: bool = False  # open the page where there is a screen
    folder: str = ""  # of the run; empty: not known
    command: str = ""  # that repeats the run
    trust: tuple[str, ...] = ()  # testbeds of your own that may be loaded, to be drawn


class ConsoleNode:
    """A page over a live bench.

    Args:
        settings: None: the parameters of the node.
        notify: called with the address of the page.
        loop: loop that serves the node.

    Raises:
        BadInput: the port cannot be opened.
    """

    def __init__(
        self, settings: ConsoleSettings | None, notify: Callable[[str], None], loop: Loop
    ) -> None:
        os.nice(_NICE)
        self.node = node = new_node("console")
        loop.live(node, "console")
        parameters: ConsoleSettings = settings or settings_of(node, ConsoleSettings)
        self._link = LiveLink(
            node, parameters.folder, parameters.command, Trust.of(parameters.trust)
        )
        self._page = Page(self._link, parameters.host, parameters.port, notify)
        if parameters.browser:
            self._page.server.open_browser()

    def poll(self) -> float:
        """Serve the bench and the page."""
        return self._page.poll()

    def close(self) -> None:
        """End the page."""
        self._page.close()

    def leave(self) -> None:
        """Leave the graph."""
        self._link.close()


def console(settings: ConsoleSettings, notify: Callable[[str], None], namespace: str = "") -> None:
    """Serve a page over the bench of a namespace until interrupted, then exit."""
    run_node(partial(ConsoleNode, settings, notify), args=namespace_arguments(namespace))


def main() -> None:
    """Run the node with the parameters of ConsoleSettings."""
    run_node(partial(ConsoleNode, None, partial(print, flush=True)))


if __name__ == "__main__":
    main()
