"""Checks of what a report promises of its page: valid HTML, small, and self-contained."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import html5lib

MOST = 2_000_000  # bytes


class _Outside(HTMLParser):
    """Collects what a page would load from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in ("script", "link", "iframe", "object", "embed", "base", "form"):
            self.found.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "srcset", "data") and not (
                value or ""
            ).startswith(("#", "data:")):
                self.found.append(f"{tag} {name}={value}")


def check(text: str) -> None:
    """Assert that a page is valid HTML 5, below 2 MB, self-contained, and has no id twice."""
    html5lib.HTMLParser(strict=True).parse(text)
    outside = _Outside()
    outside.feed(text)
    told = re.sub(
        r"<pre>.*?</pre>|base64,[\w+/=\s]*", "", text, flags=re.DOTALL
    )  # four letters are in any picture
    assert outside.found == [] and "http" not in told
    assert not re.search(r"url\((?!#)", text) and "@import" not in text
    names = re.findall(r'\bid="([^"]*)"', text)
    assert len(names) == len(set(names)) and {f"#{name}" for name in names} >= set(
        re.findall(r"url\((#[^)]*)\)", text)
    )
    assert len(text.encode()) < MOST
