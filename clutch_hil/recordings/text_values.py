"""Text values: numbers, times, and on and off, that a column of a binary file has as text, as exports of tools write them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from clutch_hil.recordings.channel import Channel, Signal
from clutch_hil.recordings.state_names import name_states
from clutch_hil.recordings.text.cells import Cells, show
from clutch_hil.recordings.text.clock import Clock
from clutch_hil.recordings.text.column import BIT_FIELD, BitField, DecimalDoubt
from clutch_hil.recordings.text.column_kind import judge_columns
from clutch_hil.recordings.text.marks import tells_decimal
from protocols.errors import InputError
from protocols.files.arrow import from_texts

_MOST_STATES = 32  # different words of a column of states
_JUDGED = 1000  # values that tell what a column is, at the beginning and at the end


def convert_texts(path: Path, channel: Channel, texts: Sequence[str | None], notes: list[str]) -> Signal:
    """The signal of a channel of text. Raises InputError for words, and for numbers or dates that can be read in two ways.

    notes: a sentence on what the text is is appended.
    """
    column = from_texts(["" if text is None else text.strip() for text in texts])
    if channel.states:
        parsed = Cells(states=channel.states).parse_flags(column)
        if parsed.row >= 0:
            raise InputError(
                f"recording {path}: {channel.path!r} holds text, {show(parsed.word)} in row {parsed.row}, which is no number;"
                " give its number in `states` of the map"
            )
        return Signal(name_states(channel), parsed.values)
    samples = [*column[:_JUDGED].to_pylist(), *column[_JUDGED:][-_JUDGED:].to_pylist()]
    kind = judge_columns([[text] for text in samples], 1, Cells(), None)[0]
    cells = kind.choose_cells(Cells())

    def refuse(row: int, what: str) -> NoReturn:
        raise InputError(
            f"recording {path}: {channel.path!r} holds text, {show(column[row].as_py())} in row {row}, which is {what}; save"
            " numbers as numbers"
        )

    first = next((row for row, text in enumerate(samples) if not cells.is_missing(text)), 0)
    if kind.kind == "text" or kind.unit or not len(column):
        remedy = "; set `states` in the map where its words stand for numbers" if _are_states(samples) else ""
        raise InputError(
            f"recording {path}: {channel.path!r} holds text{f', such as {show(samples[first])}' if samples else ''};"
            f" allowed are columns of numbers, also of numbers, times or on and off as text{remedy}"
        )
    if kind.time and kind.time.doubt:
        raise InputError(
            f"recording {path}: {channel.path!r} holds text such as {show(samples[first])}, which"
            f" {kind.time.doubt.partition('; set')[0]}; write it as year-month-day"
        )
    if kind.time:
        clock = Clock(kind.time)
        values, bad = clock.parse(column, cells.find_missing(column))
        if bad >= 0:
            refuse(bad, f"no time ({kind.time.what})")
        notes.append(f"{channel.path}: times as text ({kind.time.what}), counted in s from the first, {clock.start}")
        return Signal(replace(channel, kind="time", unit="s"), values)
    if kind.kind == "status":
        parsed = cells.parse_flags(column)
    else:
        parsed = (cells.parse_hexadecimal if kind.hexadecimal else cells.parse)(column)
        if not tells_decimal([samples], cells):
            decimal = DecimalDoubt(cells.decimal)
            decimal.look(column)
            if cell := decimal.find_doubt():
                raise InputError(
                    f"recording {path}: {channel.path!r} holds text such as {cell!r}, which can be a fraction or have a mark"
                    " between thousands; save numbers as numbers"
                )
    if parsed.row >= 0:
        refuse(parsed.row, "no number")
    bits = BitField()
    bits.look(column)
    notes += [BIT_FIELD.format(channel.path, cell)] if (cell := bits.find()) else []
    mark = f", {cells.decimal!r} as decimal mark" if kind.kind == "number" else ""
    notes.append(f"{channel.path}: {'on and off' if kind.kind == 'status' else 'numbers'} as text{mark}")
    return Signal(replace(channel, kind=kind.kind), parsed.values)


def _are_states(samples: Sequence[str | None]) -> bool:
    """Return whether the samples are few words that come again and again."""
    return len(set(samples)) <= min(_MOST_STATES, len(samples) // 2)
