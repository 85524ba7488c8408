"""Update of the guide's tables from new results: ``python -m softness_bayes.tools.doc_tables DIR``.

On a page, each table is enclosed by ``<!-- FILE -->`` and ``<!-- /FILE -->``, where FILE is the file in DIR to which
the command or study that is named there wrote it. Tables whose files are not in DIR stay.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import softness_bayes

DOCS = Path(softness_bayes.__file__).parent / "docs"


def filled(text: str, results: Path) -> str:
    """Return the text of a page with the tables of a directory of results."""

    def table(match: re.Match[str]) -> str:
        path = results / match[1]
        if not path.exists():
            return match[0]
        return f"<!-- {match[1]} -->\n\n{path.read_text(encoding='utf-8').strip()}\n\n<!-- /{match[1]} -->"

    return re.sub(r"<!-- ([\w/]+\.(?:md|txt)) -->\n.*?<!-- /\1 -->", table, text, flags=re.DOTALL)


def main(arguments: list[str]) -> None:
    """Fill in the tables of every page from the directory that is given."""
    for path in sorted(DOCS.glob("*.md")):
        path.write_text(filled(path.read_text(encoding="utf-8"), Path(arguments[0])), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
