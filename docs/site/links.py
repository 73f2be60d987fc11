"""Links of the built site that lead nowhere: no page, no picture or no heading is there."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Page(HTMLParser):
    """What a page links to, and the places in it that can be linked to."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = set()
        self.feed(page.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value is None:
                continue
            if name in ("href", "src"):
                self.links.append(value)
            elif name == "id" or (name == "name" and tag == "a"):
                self.places.add(value)


def dead_links(site: Path) -> list[str]:
    """Every dead link inside the site, as "page: link"; addresses of other sites are not asked."""
    pages = {path.resolve(): _Page(path) for path in sorted(site.rglob("*.html"))}
    dead: list[str] = []
    for path, page in pages.items():
        if path.name == "404.html":  # its links hold for where it is served, which is anywhere
            continue
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            place = unquote(parts.fragment)
            there = target.exists() and (
                not place
                or place.startswith("__")  # made by scripts of the theme
                or target not in pages
                or place in pages[target].places
            )
            if not there:
                dead.append(f"{path.relative_to(site.resolve())}: {link}")
    return dead
