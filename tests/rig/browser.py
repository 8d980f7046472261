"""Debian's Chromium without a screen, for tests that look at a page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Page, sync_playwright

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

SIZES = [(1280, 800), (1920, 1080)]
PLACES = ".cell, header, aside > *, footer"
"""Of the live page: what no text may reach out of."""
TRACED = """() => state.channels.filter((channel, place) => ["cycle", "trend"].every(plot =>
    cells[place].cell.dataset[plot] === Object.keys(channel.traces).join(" "))).length"""
"""Of the live page: channels with both plots of all that they have."""

needs_chromium = pytest.mark.skipif(not CHROMIUM.exists(), reason="Debian's chromium is not installed")

_TEXTS = """places => {
  const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const inside = (box, other) => [Math.max(box.left, other.left), Math.max(box.top, other.top),
    Math.min(box.right, other.right), Math.min(box.bottom, other.bottom)];
  for (let node; (node = walker.nextNode());) {
    const parent = node.parentElement;
    if (!node.data.trim() || parent.closest("script, style, title") || !parent.checkVisibility()) continue;
    const range = document.createRange(), place = parent.closest(places) ?? document.body;
    range.selectNodeContents(node);
    const room = inside(place.getBoundingClientRect(), document.body.getBoundingClientRect());
    for (const box of range.getClientRects()) if (box.width && box.height)
      found.push([node.data.trim(), [box.left, box.top, box.right, box.bottom], room]);
  }
  return found;
}"""


def faults_of_texts(page: Page, places: str) -> list[str]:
    """Texts of a page that reach out of their place (a CSS selector), or lie on each other."""
    found, faults = page.evaluate(_TEXTS, places), []
    for at, (text, (left, top, right, bottom), room) in enumerate(found):
        out = max(room[0] - left, room[1] - top, right - room[2], bottom - 0.5 - room[3])
        if out > 0.5:
            faults.append(f"{text}: cut by {out:.1f} px")
        for other, box, _ in found[at + 1 :]:
            over = min(right, box[2]) - max(left, box[0]), min(bottom, box[3]) - max(top, box[1])
            if min(over) > 1.5:
                faults.append(f"{text}: on {other}, {over[0]:.1f} x {over[1]:.1f} px")
    return faults


def faults_of_report(html: Path, texts: int = 20) -> list[str]:
    """Those of a page with plots of more than so many `texts`, at every size; pictures lie beside it."""
    with browser_page() as page:
        for width, height in SIZES:
            page.set_viewport_size({"width": width, "height": height})
            page.goto(html.as_uri())
            page.wait_for_function("[...document.querySelectorAll('.plot')].every(plot => plot.calcdata)")
            page.screenshot(path=html.with_suffix(f".{width}.png"), full_page=True)
            assert page.locator("svg text").count() > texts
            if faults := faults_of_texts(page, "section, header, nav"):
                return faults
    return []


@contextmanager
def browser_page() -> Iterator[Page]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        try:
            yield browser.new_page(viewport={"width": 1400, "height": 1000})
        finally:
            browser.close()
