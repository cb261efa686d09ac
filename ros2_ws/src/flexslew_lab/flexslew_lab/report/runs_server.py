"""The page over all runs, served on loopback so that its buttons act: overlay, trash, note, tags.

The address contains a token as its first folder, so no other page and no other user can guess it.
"""

import json
import secrets
from collections.abc import Callable, Sequence
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from flexslew_lab.report.report import write_report
from flexslew_lab.report.run_notes import move_to_trash, require_run, set_note, set_tags
from flexslew_lab.report.runs_index import PAGE, write_index
from flexslew_lab.trial.outputs import bag_folder, new_file
from flexslew_plant.errors import BadInput, FlexslewError

HOST = "127.0.0.1"
_LARGEST = 1 << 16  # bytes of a request


def runs_server(folder: Path, port: int = 0) -> tuple[ThreadingHTTPServer, str]:
    """Return a server of the runs of a folder, which listens, and the address of its page.

    Args:
        folder: with one folder per run.
        port: on loopback; 0 takes any.

    Raises:
        BadInput: the port cannot be opened.
    """
    token = secrets.token_urlsafe(24)
    handler = partial(_Handler, folder.resolve(), f"/{token}/")
    try:
        server = ThreadingHTTPServer((HOST, port), handler)
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise BadInput(f"--port: {port} cannot be opened: {why}") from None
    return server, f"http://{HOST}:{server.server_address[1]}/{token}/"


class _Handler(SimpleHTTPRequestHandler):
    """Answers one request.

    Args:
        folder: with one folder per run.
        prefix: of every path that is answered.
        arguments: of the base class.
    """

    def __init__(self, folder: Path, prefix: str, *arguments: Any) -> None:
        self._folder, self._prefix = folder, prefix
        super().__init__(*arguments, directory=str(folder))

    def do_GET(self) -> None:
        """Send a file of the folder; the page is written again before."""
        if self._is_admitted():
            if self.path in ("/", f"/{PAGE}"):
                write_index(self._folder)
            super().do_GET()

    def do_HEAD(self) -> None:
        """Send the head of a file of the folder."""
        if self._is_admitted():
            super().do_HEAD()

    def do_POST(self) -> None:
        """Act on runs: a JSON object with `runs`, their names, and `value`."""
        if not self._is_admitted():
            return
        try:
            length = int(self.headers.get("content-length", "0"))
            request = json.loads(self.rfile.read(length)) if 0 < length <= _LARGEST else {}
            runs = [self._run(name) for name in request["runs"]]
            reply = _ACTIONS[self.path.removeprefix("/")](runs, str(request["value"]))
        except FlexslewError as error:
            self._reply(400, str(error))
        except OSError as error:
            self._reply(400, error.strerror or str(error))
        except (ValueError, KeyError, TypeError) as error:
            self._reply(400, f"no such action: {error!r:.100}")
        else:
            self._reply(200, reply)

    def end_headers(self) -> None:
        """Add that nothing is kept, and that no other page learns the address."""
        for name, value in (("cache-control", "no-store"), ("referrer-policy", "no-referrer")):
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing for each request."""

    def _is_admitted(self) -> bool:
        """Return whether the request has the token, which is taken off its path; else refuse it."""
        host = f"{HOST}:{self.connection.getsockname()[1]}"
        if self.path.startswith(self._prefix) and self.headers.get("host") == host:
            self.path = self.path.removeprefix(self._prefix[:-1])
            return True
        self._reply(403, "use the address that was printed at the start: it contains a token")
        return False

    def _run(self, name: object) -> Path:
        if not isinstance(name, str) or name != Path(name).name:
            raise BadInput("is no name of a run", key="runs", value=name)
        return require_run(self._folder / name)

    def _reply(self, status: int, words: str) -> None:
        body = words.encode()
        self.send_response(status)
        self.send_header("content-type", "text/plain; charset=utf-8")
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


def _overlay(runs: Sequence[Path], value: str) -> str:
    """Return the name of the page with these runs over one another."""
    if not runs:
        raise BadInput("select at least one run")
    page = runs[0].parent / new_file("overlay.html").name
    return write_report([bag_folder(run) for run in runs], page).name


def _trash(runs: Sequence[Path], value: str) -> str:
    for run in runs:
        move_to_trash(run)
    return ""


def _note(runs: Sequence[Path], value: str) -> str:
    for run in runs:
        set_note(run, value)
    return ""


def _tags(runs: Sequence[Path], value: str) -> str:
    for run in runs:
        set_tags(run, value.split(","))
    return ""


_ACTIONS: dict[str, Callable[[Sequence[Path], str], str]] = {
    "overlay": _overlay,
    "trash": _trash,
    "note": _note,
    "tags": _tags,
}
