"""A headless Chromium, driven over the WebDriver protocol, for tests that look at a page."""

import atexit
import json
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from time import sleep
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FOUND = "document.evaluate(arguments[0], document, null, 9, null).singleNodeValue"
_STILL = f"""
  const shown = {FOUND};
  if (!shown?.checkVisibility()) return false;
  const place = JSON.stringify(shown.getBoundingClientRect());
  if (place !== look.place) [look.place, look.since] = [place, performance.now()];
  return performance.now() - look.since > 150
"""
_FOCUSED = f"""
  const field = {FOUND};
  if (!field?.checkVisibility() || field.disabled) return false;
  if (document.activeElement !== field || look.field !== field) {{
    field.scrollIntoView({{block: 'nearest'}});
    field.focus();
    [look.field, look.since] = [field, performance.now()];
  }}
  field.select();
  return document.activeElement === field && performance.now() - look.since > 150
"""
NO_CHROMIUM = "no Chromium with chromedriver"


class Browser:
    """One window; pages are looked at in any width.

    Args:
        address: of the session at the driver.
    """

    def __init__(self, address: str) -> None:
        self._address = address

    def open(self, page: Path | str, width: int, height: int = 900, scale: float = 1.0) -> None:
        """Show a page in a window of this size [px] and wait until it is loaded.

        A small scale has fewer dots to draw, where nobody looks at them.
        """
        url = page.resolve().as_uri() if isinstance(page, Path) else page
        self.devtools(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": width < 600},
        )
        _call("POST", f"{self._address}/timeouts", {"script": 240_000})
        _call("POST", f"{self._address}/url", {"url": "about:blank"})
        _call("POST", f"{self._address}/url", {"url": url})
        drawn = "return new Promise(then => requestAnimationFrame(() => setTimeout(then, 0)))"
        self.run(drawn)
        self.until("return document.documentElement.dataset.figures !== 'waiting'")

    def show(self, page: Path) -> None:
        """Show a page and wait for nothing: where its scripts may not run."""
        _call("POST", f"{self._address}/url", {"url": page.resolve().as_uri()})

    def run(self, script: str, *arguments: Any) -> Any:
        """Return what the body of a JavaScript function returns, promises awaited."""
        return _call(
            "POST", f"{self._address}/execute/sync", {"script": script, "args": list(arguments)}
        )

    def click(self, path: str, tries: int = 20) -> None:
        """Click the element that an XPath finds, once it is still, where a person would hit it.

        Where the page draws it again before the click, the new one has to be still, too.
        """
        self.until(_STILL, path)
        try:
            _call("POST", f"{self._element(path)}/click", {})
        except AssertionError as error:
            if not tries or "stale element" not in str(error):
                raise
            self.click(path, tries - 1)

    def write(self, path: str, text: str) -> None:
        """Replace what stands in a field that a person could write into, once it keeps the focus.

        A choice that has just closed takes the focus back, which a person sees before he writes.
        """
        self.until(_FOCUSED, path)
        self.devtools("Input.insertText", {"text": text})

    def choose(self, path: str, file: Path) -> None:
        """Choose a file for an input of files, which may be hidden."""
        _call("POST", f"{self._element(path)}/value", {"text": str(file)})

    def press(self, key: str, code: str) -> None:
        """Press a key wherever the focus is."""
        for kind in ("keyDown", "keyUp"):
            self.devtools("Input.dispatchKeyEvent", {"type": kind, "key": key, "code": code})

    def until(self, script: str, *arguments: Any, within: float = 180.0) -> Any:
        """Return the first true value of the body of a JavaScript function."""
        found = self.run(
            "const [limit, ...rest] = arguments; const end = performance.now() + limit;"
            f"const look = function () {{ {script} }};"
            "return new Promise(then => { const again = () => { const value = look(...rest);"
            " if (value || performance.now() > end) then(value); else setTimeout(again, 50); };"
            " again(); })",
            within * 1000.0,
            *arguments,
        )
        assert found, (script, arguments, self.run("return document.body.innerText"))
        return found

    def _element(self, path: str) -> str:
        self.until(f"return {FOUND} !== null", path)
        requested = {"using": "xpath", "value": path}
        found = _call("POST", f"{self._address}/element", requested)
        return f"{self._address}/element/{next(iter(found.values()))}"

    def devtools(self, command: str, parameters: dict[str, Any]) -> Any:
        """Return the answer to a command of the DevTools protocol."""
        return _call(
            "POST", f"{self._address}/goog/cdp/execute", {"cmd": command, "params": parameters}
        )

    def complaints(self) -> list[str]:
        """Return errors and warnings of the console since the last call."""
        entries = _call("POST", f"{self._address}/se/log", {"type": "browser"})
        return [e["message"] for e in entries if e["level"] in ("SEVERE", "WARNING")]

    @contextmanager
    def another_window(self) -> Iterator[None]:
        """Work in a second window meanwhile; it is closed afterwards."""
        first = _call("GET", f"{self._address}/window", None)
        second = _call("POST", f"{self._address}/window/new", {"type": "window"})["handle"]
        _call("POST", f"{self._address}/window", {"handle": second})
        try:
            yield
        finally:
            _call("DELETE", f"{self._address}/window", None)
            _call("POST", f"{self._address}/window", {"handle": first})

    def picture(self, path: Path, whole: bool = True) -> None:
        """Save the page as PNG: the whole of it, or what the window shows without drawing anew."""
        from base64 import b64decode

        shot = self.devtools("Page.captureScreenshot", {"captureBeyondViewport": whole})
        path.write_bytes(b64decode(shot["data"]))


@cache
def find_chromium() -> tuple[str, str] | None:
    """Return the paths of Chromium and chromedriver, or None where one of them does not run.

    A program that only names the package to install, as on Ubuntu, does not count.
    FLEXSLEW_BROWSER=0 counts as no browser.
    """
    if os.environ.get("FLEXSLEW_BROWSER") == "0":
        return None
    browser = next(filter(None, map(_running, CHROMIUM)), None)
    driver = _running("chromedriver")
    return (browser, driver) if browser and driver else None


def _running(name: str) -> str | None:
    """Return the path of a program that reports its version."""
    path = shutil.which(name)
    if path is not None:
        with suppress(OSError, subprocess.SubprocessError):
            subprocess.run([path, "--version"], capture_output=True, check=True, timeout=60.0)
            return path
    return None


@contextmanager
def chromium(*more: str) -> Iterator[Browser]:
    """Yield a browser; skip the test where there is none.

    Args:
        more: options of the command line.
    """
    found = find_chromium()
    if found is None:
        pytest.skip(NO_CHROMIUM)
    binary, driver = found
    root = _serving(driver)
    with tempfile.TemporaryDirectory() as profile:
        options = {
            "binary": binary,
            "args": [
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-dev-shm-usage",
                "--hide-scrollbars",
                "--disable-background-networking",
                f"--user-data-dir={profile}",
                *more,
            ],
        }
        requested = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        answer = _call("POST", f"{root}/session", {"capabilities": {"alwaysMatch": requested}})
        session = f"{root}/session/{answer['sessionId']}"
        try:
            yield Browser(session)
        finally:
            _call("DELETE", session, None)


@cache
def _serving(driver: str) -> str:
    """Return the address of chromedriver: one for all browsers of this process, which ends it."""
    output = tempfile.TemporaryFile("w+")  # noqa: SIM115 (kept while the driver runs)
    child = subprocess.Popen(
        [*_unprivileged(), driver, "--port=0"], stdout=output, stderr=subprocess.STDOUT
    )
    atexit.register(_end, child)
    address: re.Match[str] | None = None
    while address is None:
        ended = child.poll()
        output.seek(0)
        text = output.read()
        assert ended is None, f"{driver} ended at its start with {ended}: {text}"
        address = re.search(r"started successfully on port (\d+)", text)
        sleep(0.02)
    return f"http://127.0.0.1:{address[1]}"


def _end(child: "subprocess.Popen[bytes]") -> None:
    child.terminate()
    child.wait(10)


def _unprivileged() -> list[str]:
    """Return a prefix with which root starts a browser as others do: no more urgent than a bench.

    With the right to, Chromium draws at nice -8, and the nodes of a bench wait for its frames.
    """
    found = shutil.which("setpriv") if os.geteuid() == 0 else None
    return [found, "--bounding-set=-sys_nice"] if found else []


def _call(method: str, address: str, body: Any) -> Any:
    data = json.dumps(body).encode() if body is not None else None
    request = Request(address, data, {"Content-Type": "application/json"}, method=method)
    try:
        with urlopen(request, timeout=240) as reply:
            return json.load(reply)["value"]
    except HTTPError as error:
        raise AssertionError(json.load(error)["value"]["message"]) from None


LOOK = Path(__file__).with_name("look.js").read_text()
PALE = Path(__file__).with_name("pale.js").read_text()


def looked_at(browser: Browser) -> dict[str, Any]:
    """Return what is wrong with the text of the page: overlaps, what lies outside, broken words."""
    found: dict[str, Any] = browser.run(LOOK)
    return found
