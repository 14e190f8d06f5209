"""Sheet: the rows of one sheet of a workbook, read one after the other."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, iterparse

from openpyxl.cell.read_only import ReadOnlyCell
from openpyxl.worksheet._reader import FORMULA_TAG, ROW_TAG, WorkSheetParser

from clutch_hil.recordings.excel.cell_text import CellTexts
from protocols.errors import InputError

_MOST_ROWS, _MOST_COLUMNS = 1_048_576, 16_384  # of Excel
_MOST_CELLS = 20_000_000  # of a sheet, also empty ones: about three minutes; text is read in seconds
_WITHOUT_VALUE = "formula without a value"  # text of such a cell: no number, and a reason


@dataclass(frozen=True)
class Row:
    """number: from 1, as Excel shows it. cells: (column from 1, text), without empty ones. numbers: how many are numbers."""

    number: int
    cells: list[tuple[int, str]]
    numbers: int


class Sheet:
    """The rows of a sheet of openpyxl, in read-only mode; cells of the sheet beyond the limits of Excel are refused.

    hidden: rows so far that Excel hides. formulas, zeros, valueless: cells so far with a formula, those of them with the value
    0, and those without a value.
    """

    def __init__(self, path: Path, sheet: Any, decimal: str) -> None:
        self._path, self._sheet = path, sheet
        self.hidden = self.formulas = self.zeros = self.valueless = 0
        self.texts = CellTexts(decimal, sheet.parent.epoch, self._find_format)

    def read(self) -> Iterator[Row]:
        """Yield the rows that have cells, in their order. Raises InputError, and what the parser raises for a damaged file."""
        last = count = 0
        with self._sheet._get_source() as source:
            # Without formats of dates it returns them as numbers. Its own loop also reads what stands below the rows
            parser = WorkSheetParser(source, self._sheet._shared_strings, data_only=True)
            for _, element in iterparse(source):
                if element.tag == ROW_TAG:
                    number, cells = parser.parse_row(element)
                    if not last < number <= _MOST_ROWS:
                        raise InputError(
                            f"recording {self._path}: sheet {self._sheet.title!r} has row {number} after row {last}; allowed"
                            f" are rows from 1 to {_MOST_ROWS}, in their order"
                        )
                    last = number
                    count += len(cells)
                    if count > _MOST_CELLS:
                        raise InputError(
                            f"recording {self._path}: sheet {self._sheet.title!r} has more than"
                            f" {_MOST_CELLS // 1_000_000} million cells, which is the most that is allowed; save it as CSV"
                        )
                    self.hidden += element.get("hidden") in ("1", "true")
                    row = self._make_row(number, element, cells)
                    element.clear()
                    if row.cells:
                        yield row
                elif element.tag.endswith("}sheetData"):
                    return

    def _make_row(self, number: int, element: Element, cells: list[dict[str, Any]]) -> Row:
        texts: list[tuple[int, str]] = []
        numbers = last = 0
        for node, cell in zip(element, cells, strict=True):
            value, kind = cell["value"], cell["data_type"]
            if node.find(FORMULA_TAG) is not None:
                self.formulas += 1
                self.zeros += value == 0
                if value is None and node.get("t") != "str":  # else its value is a text without letters
                    self.valueless += 1
                    value, kind = _WITHOUT_VALUE, "s"
            if not last < cell["column"] <= _MOST_COLUMNS:
                raise InputError(
                    f"recording {self._path}: sheet {self._sheet.title!r} has column {cell['column']} after column {last} in"
                    f" row {number}; allowed are columns from 1 to {_MOST_COLUMNS}, in their order"
                )
            last = cell["column"]
            if value is None:
                continue
            text = self.texts.write(value, kind, cell["style_id"])
            numbers += kind == "n" or text[:1].isdigit()
            if text:
                texts.append((cell["column"], text))
        return Row(number, texts, numbers)

    def _find_format(self, style: int) -> str:
        return str(ReadOnlyCell(self._sheet, 1, 1, None, "n", style).number_format)
