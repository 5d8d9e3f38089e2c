"""Looks at a page in a browser, and remembers all that the page complained of or asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PATIENCE_MS = 60_000


@dataclass
class Look:
    """An open page: what stood on its console, and what it asked the network for."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def settle(self) -> None:
        """Wait until every figure is drawn."""
        self.page.wait_for_function("document.documentElement.dataset.drawn === 'true'", timeout=PATIENCE_MS)

    def overflow(self) -> int:
        """Return by how many pixels the page is wider than the screen."""
        width: int = self.page.evaluate(
            "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        )
        return width

    def smallest_text(self) -> float:
        """Return the smallest size (pixels) of any text that is shown."""
        size: float = self.page.evaluate("""() => {
            let least = Infinity;
            const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
            while (walker.nextNode()) {
                const owner = walker.currentNode.parentElement;
                if (!walker.currentNode.textContent.trim() || !owner.getClientRects().length) continue;
                if (owner.closest("script, style, .modebar")) continue;
                least = Math.min(least, parseFloat(getComputedStyle(owner).fontSize));
            }
            return least;
        }""")
        return size

    def empty_plots(self) -> list[str]:
        """Return the figures in which nothing is drawn."""
        names: list[str] = self.page.evaluate("""() =>
            Array.from(document.querySelectorAll("figure"))
                .filter(f => !f.querySelector(".plot .trace, .plot .heatmaplayer image"))
                .map(f => f.id)""")
        return names


@contextmanager
def look_at(browser: Browser, file: Path, *, width: int, scheme: Literal["light", "dark"]) -> Iterator[Look]:
    """Open a file in a window of its own and wait until it is drawn."""
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, has_touch=width < 600
    )
    look = Look(context.new_page())
    look.page.on("console", lambda message: look.complaints.append(f"{message.type}: {message.text}"))
    look.page.on("pageerror", lambda error: look.complaints.append(f"error: {error}"))
    look.page.on("request", lambda request: look.requests.append(request.url))
    look.page.goto(file.as_uri())
    look.settle()
    yield look
    context.close()
