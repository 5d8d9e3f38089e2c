"""From a page's contents to one HTML file that needs nothing else: no network, no other file."""

from __future__ import annotations

from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from bus.extras import installing
from orchestrator.report.contents import Page
from orchestrator.report.errors import ReportError
from orchestrator.report.payload import payload

MISSING = f"a report needs {{}}: {installing('report')}"


def plotly_js() -> str:
    """Return the source of Plotly's JavaScript, as its Python package ships it; raises `ReportError`."""
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise ReportError(MISSING.format("plotly")) from None
    source: str = get_plotlyjs()
    return source.replace("</script", "<\\/script")


def require_libraries() -> None:
    """Raise `ReportError` unless a page can be made: for those who would find out after hours of work."""
    for name in ("plotly", "jinja2"):
        if find_spec(name) is None:
            raise ReportError(MISSING.format(name))


def html(page: Page) -> str:
    """Return the whole page; equal contents give equal text. Raises `ReportError` without its libraries."""
    try:
        from jinja2 import Environment, StrictUndefined
        from markupsafe import Markup
    except ImportError:
        raise ReportError(MISSING.format("jinja2")) from None
    room = files("orchestrator.report")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    shipped = {name: Markup((room / file).read_text()) for name, file in _SHIPPED.items()}
    return environment.from_string((room / "page.html").read_text()).render(
        page=page, payload=Markup(payload(page.figures)), plotly=Markup(plotly_js()), **shipped
    )


_SHIPPED = {"style": "style.css", "behaviour": "behaviour.js"}


def write_page(page: Page, out: Path) -> int:
    """Write a page and return its size in bytes; raises `ReportError` when the file cannot be written."""
    text = html(page).encode()
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(text)
    except OSError as error:
        raise ReportError(f"{out} cannot be written: {error.strerror}; choose another --out") from error
    return len(text)
