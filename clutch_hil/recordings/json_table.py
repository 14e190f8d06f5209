"""A JSON file, in a separate process: the table in it is written into a Feather file.

Rows are objects, one after another or in a list, or lists of numbers. Columns are lists of one length. What pandas writes with
`orient` is one of these, or objects by the number of the row. Single numbers beside the table are kept as metadata, and so are
units.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa

from clutch_hil.recordings.channel import name_first
from protocols.errors import InputError, format_count
from protocols.input_file import read_raw

MOST_BYTES = 1 << 28  # of a file: its objects take about five times as much
_FEWEST = 2  # rows of a table
_PART = 20_000  # rows that are converted at once
_BETWEEN = " \t\r\n,\x1e"  # what may stand between objects; the last one is of RFC 7464
_SHOWN = 40  # characters of a file in a message
_DEEPEST = 8  # objects within each other


def serve(path: str, target: str) -> Callable[[Any], Any]:
    """Write the table in the file `path` to `target`. Return a function that gives notes."""
    file = Path(path)
    text = read_raw(file, "recording", MOST_BYTES).decode("utf-8-sig", "replace")
    try:
        table, notes = _find_table(file, text)
    except RecursionError:
        raise InputError(f"recording {path} cannot be read: its objects and lists are nested too deep") from None
    with pa.OSFile(target, "wb") as out, pa.ipc.new_file(out, table.schema) as writer:
        writer.write_table(table)
    return lambda question: notes


def _find_table(path: Path, text: str) -> tuple[pa.Table, list[str]]:
    documents, notes = _parse(path, text)
    document = documents[0] if len(documents) == 1 else documents
    beside: dict[str, Any] = {}
    if isinstance(document, dict):
        document, beside = _take_table(path, document)
    if isinstance(document, dict):
        columns = document
    elif all(isinstance(row, dict) for row in document):
        columns = {name: None for row in document for name in row}
        notes.append(f"{format_count(len(document), 'object')} of JSON, each a row")
    elif all(isinstance(row, list) for row in document) and len({len(row) for row in document}) == 1:
        columns = _turn(path, document)
    else:
        raise _refuse(path)
    if len(document) < _FEWEST and not isinstance(document, dict):
        raise _refuse(path)
    arrays = {
        name: _make_array([row.get(name) for row in document] if values is None else values)
        for name, values in columns.items()
    }
    metadata = {key: json.dumps(value) for key, value in beside.items()}
    return pa.table(arrays).replace_schema_metadata(metadata), notes


def _parse(path: Path, text: str) -> tuple[list[Any], list[str]]:
    """Return the objects and lists in a text, one after another. A last one that is cut is left out, and told."""
    documents: list[Any] = []
    decoder, place = json.JSONDecoder(), 0
    while True:
        while place < len(text) and text[place] in _BETWEEN:
            place += 1
        if place == len(text) or (text[place] == "\0" and not text[place:].strip("\0")):
            return documents, []
        try:
            one, place = decoder.raw_decode(text, place)
        except ValueError as error:
            line = text.count("\n", 0, place) + 1
            if len(documents) >= _FEWEST and "\n" not in text[place:].strip():
                return documents, [f"left out line {line}, the last one, which is cut"]
            raise InputError(
                f"recording {path} cannot be read: line {line}, {text[place : place + _SHOWN]!r}, begins what is no JSON"
                f" ({error})"
            ) from None
        documents.append(one)


def _take_table(path: Path, document: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Return the table in an object, as columns by name or as rows, and what stands beside it."""
    if {"columns", "data"} <= document.keys() and all(isinstance(document[key], list) for key in ("columns", "data")):
        rows = document["data"]
        if not all(isinstance(row, list) and len(row) == len(document["columns"]) for row in rows):
            raise _refuse(path)
        names = [" ".join(map(str, name)) if isinstance(name, list) else str(name) for name in document["columns"]]
        _check_names(path, names)
        return [dict(zip(names, row, strict=True)) for row in rows], {}
    inner = list(document.values())
    if len(inner) > 1 and all(isinstance(one, dict) and one.keys() == inner[0].keys() for one in inner):
        if all(key.isdigit() for key in document):  # rows by their number
            return inner, {}
        if len(inner[0]) >= _FEWEST and all(key.isdigit() for key in inner[0]):  # columns, by the number of the row
            return {name: list(one.values()) for name, one in document.items()}, {}
    found: dict[tuple[str, str], list[Any]] = {}
    beside: dict[str, Any] = {}
    rows = _collect(document, "", found, beside, 0)
    alone = len({before for before, _ in found}) == 1  # columns of one object need no path
    columns = {name if alone else before + name: values for (before, name), values in found.items()}
    if len(rows) == 1 and not columns:
        return next(iter(rows.values())), beside
    if {*rows} == {"data", "schema.fields"}:  # pandas with orient="table"
        return rows["data"], {}
    lengths = {len(values) for values in columns.values()}
    if len(lengths) > 1:
        shown = name_first([f"{name} has {len(values)}" for name, values in columns.items()])
        raise InputError(
            f"recording {path} cannot be read: its lists have different lengths ({shown}); write those of each length into a"
            " file of its own"
        )
    if rows or not columns or max(lengths) < _FEWEST:
        raise _refuse(path)
    return columns, beside


def _collect(
    document: Mapping[str, Any],
    before: str,
    columns: dict[tuple[str, str], list[Any]],
    beside: dict[str, Any],
    depth: int,
) -> dict[str, list[Any]]:
    """Sort the members of an object, and of those in it, into `columns` and `beside`. Return lists of rows by path.

    before: path of the object. Columns are by it and their name.
    """
    rows: dict[str, list[Any]] = {}
    for name, value in document.items():
        path = f"{before}{name}"
        if isinstance(value, list) and len(value) >= _FEWEST:
            if all(isinstance(one, dict) for one in value):
                rows[path] = value
            elif not any(isinstance(one, dict | list) for one in value):
                columns[before, name] = value
            else:
                rows |= {path: value} if all(isinstance(one, list) for one in value) else {}
        elif isinstance(value, dict) and any(isinstance(one, dict | list) for one in value.values()):
            if depth < _DEEPEST:
                rows |= _collect(value, f"{path}.", columns, beside, depth + 1)
        else:
            beside[path] = value
    return rows


def _turn(path: Path, rows: Sequence[Sequence[Any]]) -> dict[str, list[Any]]:
    """Return lists of rows as columns, whose names are the first row if it is of texts only."""
    names = [f"column {number}" for number in range(1, len(rows[0]) + 1)]
    if all(isinstance(name, str) for name in rows[0]):
        _check_names(path, rows[0])
        names, rows = [str(name) for name in rows[0]], rows[1:]
    return {name: [row[number] for row in rows] for number, name in enumerate(names)}


def _check_names(path: Path, names: Sequence[str]) -> None:
    """Raise InputError for a name of two columns: the table would lose one of them."""
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise InputError(f"recording {path} cannot be read: its column {twice[0]!r} is there twice; rename one of them")


def _make_array(values: Sequence[Any]) -> pa.ChunkedArray:
    """Return a column; numbers and words in one are all texts, so that the first word is told."""
    try:
        return _convert(values)
    except (pa.ArrowException, OverflowError):
        numbers = all(
            value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in values
        )
        other = (
            None if v is None else float(v) if numbers else v if isinstance(v, str) else json.dumps(v) for v in values
        )
        return _convert(list(other))


def _convert(values: Sequence[Any]) -> pa.ChunkedArray:
    parts: Iterable[Sequence[Any]] = (values[n : n + _PART] for n in range(0, len(values), _PART))
    arrays = [pa.array(part) for part in parts]
    kind = pa.unify_schemas([pa.schema({"": one.type}) for one in arrays], promote_options="permissive").field(0).type
    return pa.chunked_array([one.cast(kind) for one in arrays], kind)


def _refuse(path: Path) -> InputError:
    return InputError(
        f"recording {path} cannot be read: it is JSON without a table; allowed are objects that are rows, one a line or in a"
        " list, or an object of lists that are columns"
    )
