"""Update of the guide's tables from the stored results: ``python -m softness_bayes.tools.doc_tables``.

On a page, each table is enclosed by ``<!-- FILE -->`` and ``<!-- /FILE -->``, where FILE is the file in
``notebooks/results`` to which the command or study that is named there wrote it.
"""

from __future__ import annotations

import re
from pathlib import Path

import softness_bayes

PACKAGE = Path(softness_bayes.__file__).parent
DOCS, RESULTS = PACKAGE / "docs", PACKAGE.parent / "notebooks" / "results"


def filled(text: str, results: Path = RESULTS) -> str:
    """Return the text of a page with the tables of the stored results."""

    def table(match: re.Match[str]) -> str:
        stored = (results / match[1]).read_text(encoding="utf-8").strip()
        return f"<!-- {match[1]} -->\n\n{stored}\n\n<!-- /{match[1]} -->"

    return re.sub(r"<!-- ([\w/]+\.(?:md|txt)) -->\n.*?<!-- /\1 -->", table, text, flags=re.DOTALL)


def main() -> None:
    """Fill in the tables of every page."""
    for path in sorted(DOCS.glob("*.md")):
        path.write_text(filled(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
