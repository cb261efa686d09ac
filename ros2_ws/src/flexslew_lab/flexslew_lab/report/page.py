"""Pages of one file: templates with everything in them, nothing to fetch."""

import gzip
import json
import re
from base64 import b64encode
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from flexslew_lab.log.files.whole_file import write_whole

_UNITS = re.compile(  # of which no line may break: [N m], 3.2 rad/s
    r"\[[^][,]+\]|(?<=\d) (?:N m|\(N m\)|N|rad|m|s|kg|deg|dB|Hz|%)(?![\w])"
)
# where a long name may go on in the next line, and no number
_SEPARATOR = re.compile(r"(?<=[_/:])(?<!rad/)(?<!deg/)(?<![\s[]m/)(?=\w)|(?<=[.-])(?=[^\W\d])")


def render(template: str, figures: bool = True, **values: Any) -> str:
    """Return a template of this package as a page.

    Args:
        template: its file.
        figures: whether the page draws any, with plotly.js.
        values: what it shows; all text is escaped.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("flexslew_lab.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"wrapped": wrapped, "embedded": embedded}
    return environment.get_template(template).render(
        **values, plotly=_packed_plotly() if figures else ""
    )


@cache
def _packed_plotly() -> str:
    """Return plotly.js as gzip in base64: 1.9 MB in place of 4.8; the page unpacks it."""
    script = resources.files("plotly") / "package_data" / "plotly.min.js"
    return b64encode(gzip.compress(script.read_bytes(), 6, mtime=0)).decode()


def write_page(page: str, out: Path) -> Path:
    """Return the file to which a page was written, in a folder that is made where it is missing.

    Raises:
        BadInput, OSError: see write_whole.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, page)
    return out


def wrapped(text: object) -> Markup:
    """Return a text that may break after the separators inside of names, and inside of no unit."""
    whole = _UNITS.sub(lambda unit: unit[0].replace(" ", "\N{NO-BREAK SPACE}"), str(text))
    return Markup("<wbr>").join(escape(part) for part in _SEPARATOR.split(whole))


def embedded(data: Any) -> str:
    """Return plain data as JSON that may stand inside a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
