"""Check for broken links in a directory of HTML pages."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from html.parser import HTMLParser
from pathlib import Path


class _Page(HTMLParser):
    """The links of a page, and its anchors."""

    def __init__(self) -> None:
        super().__init__()
        self.places = set[str]()
        self.links = list[str]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record a tag's links and anchor names."""
        given = {name: value for name, value in attrs if value}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        self.links += [given[name] for name in ("href", "src") if name in given]


@cache
def _page(path: Path) -> _Page:
    page = _Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def unresolved(pages: Iterable[Path]) -> list[str]:
    """Return the links within a site whose target file or anchor is missing, each with its page.

    Parameters
    ----------
    pages
        The pages whose links are followed; links to other hosts are not.
    """
    _page.cache_clear()  # files may have been rewritten since the last call
    found = []
    for path in pages:
        for link in _page(path).links:
            file, _, place = link.partition("#")
            if ":" in file.partition("/")[0]:
                continue
            target = (path.parent / file).resolve() if file else path.resolve()
            known = target.is_file() and (not place or target.suffix != ".html" or place in _page(target).places)
            if not known:
                found.append(f"{path.name}: {link}")
    return found
