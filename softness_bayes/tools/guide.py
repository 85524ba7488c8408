"""Conversion of the guide's Markdown files to HTML, with links to each other and to the API reference.

Links in the Markdown files point to other files of the clone. On the site, a link to a Markdown file leads to its
page, a link to a module to its page in the API reference; every other linked file is copied.
"""

from __future__ import annotations

import posixpath
import re
import shutil
from collections.abc import Callable, Collection, Iterable
from html import unescape
from pathlib import Path

import softness_bayes

NAME = softness_bayes.__name__
CLONE = Path(softness_bayes.__file__).parents[1]
DOCS = f"{NAME}/docs"
FRONT = "README.md"
REFERENCE = f"{NAME}.html"
"""The page where the reference begins."""


def pages(clone: Path = CLONE) -> dict[str, str]:
    """Return the file and the site path of each page of the guide, the front page first.

    The order is that of the front page's table of pages.
    """
    front = (clone / FRONT).read_text(encoding="utf-8")
    listed, linked = (re.findall(rf"{begin}\[[^]]+\]\(([^)#]+\.md)\)", front, re.M) for begin in (r"^\| ", ""))
    files = [FRONT, *listed, *linked, *(f"{DOCS}/{path.name}" for path in sorted((clone / DOCS).glob("*.md")))]
    return {file: _place(file) for file in dict.fromkeys(files)}


def _place(file: str) -> str:
    """Return the site path of a Markdown file's page."""
    return "index.html" if file == FRONT else file.removeprefix(f"{DOCS}/").removesuffix(".md") + ".html"


def place_of(file: str, reference: Collection[str]) -> str:
    """Return the site path of a file of the clone.

    Parameters
    ----------
    file
        Its path in the clone.
    reference
        The pages of the API reference.
    """
    if file.endswith(".md"):
        return _place(file)
    module = file.removesuffix("/__init__.py").removesuffix(".py") + ".html"
    return module if file.endswith(".py") and module in reference else file


def build(directory: Path, reference: Collection[str], draw: Callable[..., str], clone: Path = CLONE) -> None:
    """Write all pages of the guide, and copy the files that they link to.

    Parameters
    ----------
    directory
        Output directory.
    reference
        Pages of the API reference, as paths relative to it.
    draw
        Function that fills in a page's template.
    clone
        Directory of the Markdown files.

    Raises
    ------
    FileNotFoundError
        If a page links to a file that is not in the clone.
    ValueError
        If the target page or anchor of a link does not exist.
    """
    from pdoc.render_helpers import to_html

    files = pages(clone)
    texts = {file: to_html((clone / file).read_text(encoding="utf-8")) for file in files}
    titles = {
        file: unescape(re.sub("<[^>]+>", "", text[: text.index("</h1>")])).strip() for file, text in texts.items()
    }
    guide_pages = {titles[file]: place for file, place in files.items() if file.startswith(DOCS)}
    for file, place in files.items():
        root = "../" * place.count("/")
        linked = set[str]()
        text = _relinked(texts[file], file, place, reference, linked)
        for other in linked:
            copied = directory / place_of(other, reference)
            copied.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(clone / other, copied)
        page = draw(
            title=titles[file],
            text=_with_reference(text, root, reference, directory),
            contents=getattr(texts[file], "toc_html", ""),
            pages=guide_pages,
            reference=REFERENCE,
            root=root,
        )
        target = directory / place
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(page, encoding="utf-8")
    if lost := unresolved(directory / place for place in files.values()):
        raise ValueError(f"links that lead nowhere: {'; '.join(lost)}")


def _relinked(text: str, file: str, place: str, reference: Collection[str], linked: set[str]) -> str:
    """Return a page with its links rewritten for the site, and record the files to copy."""

    def moved(match: re.Match[str]) -> str:
        attribute, link = match.groups()
        target, hash_, anchor = link.partition("#")
        if not target or ":" in target:
            return match[0]
        other = posixpath.normpath(posixpath.join(posixpath.dirname(file), target))
        there = place_of(other, reference)
        if there == other:
            linked.add(other)
        return f'{attribute}="{posixpath.relpath(there, posixpath.dirname(place) or ".")}{hash_}{anchor}"'

    return re.sub(r'\b(href|src)="([^"]+)"', moved, text)


def _with_reference(text: str, root: str, reference: Collection[str], directory: Path) -> str:
    """Return a page on which code names link to their entries in the API reference."""

    def led(match: re.Match[str]) -> str:
        parts = match[1].removeprefix(f"{NAME}.").split(".")
        for k in range(len(parts), 0, -1):
            page, anchor = f"{'/'.join((NAME, *parts[:k]))}.html", ".".join(parts[k:])
            if page in reference:
                known = not anchor or f'id="{anchor}"' in (directory / page).read_text(encoding="utf-8")
                return f'<a href="{root}{page}{f"#{anchor}" if anchor else ""}">{match[0]}</a>' if known else match[0]
        return match[0]

    return re.sub(r"(?<!\">)<code>([a-z_]+(?:\.\w+)+)</code>", led, text)


def unresolved(pages: Iterable[Path]) -> list[str]:
    """Return the links of some pages within a site whose target file or anchor is missing, each with its page."""
    lost = []
    for path in pages:
        for link in re.findall(r'\b(?:href|src)="([^"]+)"', path.read_text(encoding="utf-8")):
            file, _, anchor = unescape(link).partition("#")
            if ":" in file.partition("/")[0]:
                continue  # of another host
            target = (path.parent / file).resolve() if file else path.resolve()
            known = target.is_file() and (not anchor or target.suffix != ".html" or _has(target, anchor))
            lost += [] if known else [f"{path.name}: {link}"]
    return lost


def _has(page: Path, anchor: str) -> bool:
    """Return whether a page has an anchor."""
    return bool(re.search(rf'\b(?:id|name)="{re.escape(anchor)}"', page.read_text(encoding="utf-8")))


def lead_to_guide(directory: Path, reference: Iterable[str]) -> None:
    """Turn citations of the guide in docstrings, such as `model.md 3`, into links.

    Parameters
    ----------
    directory
        Directory of the site.
    reference
        Pages of the API reference, as paths relative to it.
    """
    sections = {}
    for path in (directory / place for place in pages().values()):
        for place in re.findall(r'<h2 id="((\d+)-[^"]*)"', path.read_text(encoding="utf-8")):
            sections[f"{path.stem}.md", place[1]] = f"{path.name}#{place[0]}"
    for page in reference:
        root = "../" * page.count("/")

        def led(match: re.Match[str], root: str = root) -> str:
            place = sections.get((match[1], match[2]))
            return match[0] if place is None else f'<a href="{root}{place}">{match[0]}</a>'

        path = directory / page
        text = path.read_text(encoding="utf-8")
        path.write_text(re.sub(r"\b([a-z]+\.md) (\d+)", led, text), encoding="utf-8")
