"""Pages opened in a tab of the browser, where there is one."""

import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from flexslew_lab.cli.terminal import print_message

Open = Annotated[bool, typer.Option("--open", help="Open the page in a tab of the browser.")]


def open_page(page: Path) -> None:
    """Open a page in a new tab, or print that there is no screen."""
    if not (_has_display() and webbrowser.open_new_tab(page.resolve().as_uri())):
        print_message("no browser here to open the page in")


def _has_display() -> bool:
    """Return whether a browser could show something; elsewhere a text browser would take over."""
    named = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    return sys.platform in ("darwin", "win32") or any(map(os.environ.get, named))
