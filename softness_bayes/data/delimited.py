"""Text files of tables: encoding, separator and rows of cells."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path

from softness_bayes.data.sheets import Sheet, sheet_of
from softness_bayes.errors import InputError

_CONTROL = re.compile("[\x00-\x08\x0e-\x1f]")
_JAPANESE = re.compile("[\u3041-\u30fe\u4e00-\u9fff]{2}")
_TOLD = re.compile('"?sep=([,;\t|])"?\n')  # Excel's own line before the header
_END = "\x1f"  # end mark behind the last row, a character that occurs in no table


def text_sheet(path: Path, content: bytes, digest: str) -> Sheet:
    """Return the rows of a text file with commas, semicolons, tabs, bars or spaces between cells.

    Raises
    ------
    InputError
        If it is not such a file; the message names file and row.
    """
    text, notes = _decode(path, content)
    if told := _TOLD.match(text):
        text = f"\n{text[told.end() :]}"  # a blank row keeps the numbers of the others
    separator = told[1] if told else _separator(text)
    rows = _rows(path, text, separator)
    return sheet_of(rows, str(path), path.name, digest, between_commas=separator == ",", notes=notes)


def _decode(path: Path, content: bytes) -> tuple[str, list[str]]:
    """Return the text of a file, each newline one character, and notes."""
    notes: list[str] = []
    wide = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        if wide:
            raise InputError(f"{path}: {error.reason} in UTF-16, expected a table saved as CSV") from None
        japanese = _is_shift_jis(content)
        text = content.decode("cp932" if japanese else "latin-1")
        notes.append(f"not UTF-8: read as {'Shift-JIS' if japanese else 'Latin-1'}")
    if control := _CONTROL.search(text):
        line = 1 + text.count("\n", 0, control.start())
        utf16 = content.count(0) > len(content) // 4
        remedy = "; is it UTF-16 without a byte-order mark? Save it as UTF-8" if utf16 else ""
        raise InputError(
            f"{path}: not a text file, expected a table saved as CSV: control character {control[0]!r} in line {line}"
            f"{remedy}"
        )
    if not text.strip():
        raise InputError(f"{path}: the file is empty, expected a header and rows")
    return text.replace("\r\n", "\n").replace("\r", "\n"), notes


def _is_shift_jis(content: bytes) -> bool:
    """Return whether bytes that are not UTF-8 are Japanese text in Shift-JIS.

    Latin-1 has letters where Shift-JIS has second bytes, and typographic quotes of Windows where it has first ones:
    two Japanese characters side by side, one of them of two bytes beyond ASCII, do not occur in it.
    """
    try:
        text = content.decode("cp932")
    except UnicodeDecodeError:
        return False
    pairs = (match[0].encode("cp932") for match in _JAPANESE.finditer(text))
    return any(max(pair[1], pair[3]) >= 0x80 and min(pair[0], pair[2]) < 0xA0 for pair in pairs)


def _separator(text: str) -> str:
    """Return the separator of the cells: the one of the first lines, or spaces if every line has as many words."""
    lines = [re.sub(r'"[^"]*"', "", line) for line in text.split("\n", 200)[:200] if line.strip()]
    header = next((line for line in lines if not line.startswith("#")), lines[0])
    if there := [mark for mark in ",;\t" if mark in header]:
        # of a comma in a title and the separator, the latter is in every line as often
        return max(
            there, key=lambda mark: (sum(line.count(mark) == header.count(mark) for line in lines), header.count(mark))
        )
    # a preamble may have none
    later = max(",;\t|", key=lambda mark: sum(mark in line for line in lines))
    if 2 * sum(later in line for line in lines) > len(lines):
        return later
    words = {len(line.split()) for line in lines}
    return " " if words == {max(words)} and max(words) > 2 else ","


def _rows(path: Path, text: str, separator: str) -> Iterator[tuple[list[str], int]]:
    """Yield the cells of each row, as many as it has, and the line where it starts.

    Raises
    ------
    InputError
        If a quotation mark is never closed, or a cell is too long.
    """
    reader = csv.reader(io.StringIO(f"{text}\n{_END}"), delimiter=separator, skipinitialspace=True)
    line, record = 1, [_END]
    try:
        for record in reader:
            if record == [_END]:
                return
            if record and record[-1].endswith(_END):
                break
            yield record, line
            line = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{path}: row {line}: {error} (is a quotation mark never closed?)") from None
    raise InputError(f"{path}: row {line}: a quotation mark is never closed")
