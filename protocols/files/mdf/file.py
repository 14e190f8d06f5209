"""MdfFile: an open MDF 3 or 4 file, and the values of its channels. Read by asammdf."""

import contextlib
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError, tell_reason
from protocols.files.bounds import MOST_BYTES, check_bytes, check_rows
from protocols.files.mdf.blocks import open_checked
from protocols.files.mdf.conversions import convert_texts, list_names, to_physical
from protocols.files.mdf.groups import MAY_BE_INVALID, VALUE_TYPES_4, GroupList, MdfChannel, is_virtual
from protocols.files.mdf.texts import cut_cells, decode, follow_offsets
from protocols.files.mdf.walk import check_inflated, make_damage_error
from protocols.files.quiet_libraries import quiet

MAGIC = (b"MDF     ", b"UnFinMF ")  # first bytes of a file
_VARYING_4, _OFFSET_BITS = 1, 64  # MDF 4: type of a channel of varying length, and bits of its offset in a row
_NO_CONVERSION: Mapping[int, int] = {4: 0, 3: 65535}  # version of MDF -> kind of a conversion that changes nothing
_TEXT_BYTES = 64  # that Python takes for a short text
_ALL_INVALID = 1  # MDF 4: flag of a channel
_OPTIONS: Mapping[str, Any] = {"process_bus_logging": False, "use_display_names": False}  # of asammdf
_LONGEST_REASON = 200  # characters of another library's error message
_MOST_INFLATED = 4 * MOST_BYTES  # bytes of one group's compressed rows: 10 s of work


class MdfFile:
    """An open file. condition: whether it is finished and complete.

    left_out: names of channels without a number or text in each row, by reason. Raises InputError.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stream, self.condition = open_checked(path)
        with self._reading():
            from asammdf import MDF

            self._mdf: Any = MDF(self._stream, **_OPTIONS)  # type: ignore[arg-type]
            weakref.finalize(
                self, _close, self._mdf, self._stream
            )  # __del__ may run at exit, when modules are already gone
            self.version = 4 if self._mdf.version >= "4" else 3
            listed = GroupList(self._mdf, self.version)
            self.groups, self.left_out = listed.groups, listed.left_out
            self.header: str = self._mdf.header.comment
            self.start = self._start()
            self.start_stamp = self._start_stamp()

    def read(self, channels: Collection[MdfChannel]) -> dict[MdfChannel, np.ndarray]:
        """Return the physical values (rows,) of `channels`; raw values for a status; NaN for invalid samples."""
        values: dict[MdfChannel, np.ndarray] = {}
        for k in dict.fromkeys(channel.group for channel in channels):
            of_group = [channel for channel in dict.fromkeys(channels) if channel.group == k]
            rows = int(self._mdf.groups[k].channel_group.cycles_nr)
            check_rows(f"recording {self._path}: {of_group[0].name} has", rows, len(of_group))
            stored = [channel for channel in of_group if not is_virtual(self._find_source(channel), self.version)]
            raw = self._read_raw(k, rows, stored) if stored else {}
            for channel in of_group:
                counted = (np.arange(rows), np.zeros(rows, bool))
                values[channel] = self._convert_to_physical(channel, *raw.get(channel, counted))
        return values

    def read_texts(self, channel: MdfChannel) -> list[str]:
        """Return the texts (rows,) of a channel of text as the file converts them, "" for an invalid one.

        Numbers of such a conversion are texts, too. Raises InputError.
        """
        group, source = self._mdf.groups[channel.group], self._find_source(channel)
        rows = int(group.channel_group.cycles_nr)
        check_rows(f"recording {self._path}: {channel.name} has", rows, 1)
        marked = self.version == 4 and bool(source.flags & MAY_BE_INVALID)
        if marked and getattr(group, "uses_ld", False):
            raise InputError(
                f"recording {self._path}: {channel.name!r} holds text that the file may mark as invalid in columns of its"
                " own; save it in rows, or as numbers"
            )
        self._check_data(channel, group, rows)
        beside = self._read_beside(channel, group, source)
        first = source.byte_offset if self.version == 4 else source.start_offset // 8
        size = source.bit_count // 8
        check_bytes(f"recording {self._path}: {channel.name} needs", rows * (size + _TEXT_BYTES))
        row_bytes = group.channel_group.samples_byte_nr
        if self.version == 4 and not getattr(group, "uses_ld", False):
            row_bytes += group.channel_group.invalidation_bytes_nr
        texts: list[str] = []
        invalid: list[np.ndarray] = []
        with self._reading():
            for fragment in self._mdf._mdf._load_data(group) if rows else ():
                data = fragment.data if self.version == 4 else fragment[0]
                cells = cut_cells(data, row_bytes, first, size)
                raw = follow_offsets(cells, beside) if beside is not None else (cell.tobytes() for cell in cells)
                texts += decode(raw, source.data_type, self.version)
                if marked:
                    place = group.channel_group.samples_byte_nr + source.pos_invalidation_bit // 8
                    bits = cut_cells(data, row_bytes, place, 1)[:, 0] >> source.pos_invalidation_bit % 8 & 1
                    invalid.append(bits.astype(bool))
                if len(texts) >= rows or not len(cells):
                    break
        if len(texts) != rows:
            raise make_damage_error(
                self._path, f"{channel.name} has {rows} rows by its header, and {len(texts)} in its data"
            )
        texts = self._convert_texts(channel, source, texts)
        if self.version == 4 and source.flags & _ALL_INVALID:
            return [""] * rows
        for row in np.flatnonzero(np.concatenate(invalid)) if invalid else ():
            texts[row] = ""
        return texts

    def _convert_texts(self, channel: MdfChannel, source: Any, texts: list[str]) -> list[str]:
        conversion = source.conversion
        if conversion is None or conversion.conversion_type == _NO_CONVERSION[self.version]:
            return texts
        try:
            if self.version == 4:
                return convert_texts(conversion, texts)
        except (ValueError, AttributeError, KeyError):
            pass
        raise InputError(
            f"recording {self._path}: {channel.name!r} holds text with an unknown conversion; save its numbers as numbers"
        )

    def _read_beside(self, channel: MdfChannel, group: Any, source: Any) -> bytes | None:
        """Return the bytes beside the rows in which the texts of a channel are; None if they are in the rows."""
        if self.version == 3 or source.channel_type in VALUE_TYPES_4:
            return None
        if source.channel_type != _VARYING_4 or source.bit_count != _OFFSET_BITS:
            raise InputError(
                f"recording {self._path}: {channel.name!r} holds text in an unknown way; save it as numbers"
            )
        infos = list(group.get_signal_data_blocks(channel.index))
        check_bytes(f"recording {self._path}: {channel.name} needs", sum(info.original_size for info in infos))
        self._check_packed(channel, infos)
        with self._reading():
            return bytes(self._mdf._mdf._load_signal_data(group=group, index=channel.index) or b"")

    def list_names(self, channel: MdfChannel) -> Mapping[float, str]:
        """Return the names of raw values of a channel; empty if the file names no single values."""
        with self._reading():
            return list_names(self._find_source(channel).conversion, self.version)

    def _convert_to_physical(self, channel: MdfChannel, raw: np.ndarray, invalid: np.ndarray) -> np.ndarray:
        source = self._find_source(channel)
        try:
            with quiet(), np.errstate(all="ignore"):
                values = to_physical(source.conversion, self.version, raw)
        except ValueError as error:
            raise InputError(f"recording {self._path}: {channel.name} cannot be converted: {error}") from None
        if self.version == 3 and is_virtual(source, self.version) and source.conversion is None:
            values = values * (source.sampling_rate or 1.0)
        values[invalid] = np.nan
        if self.version == 4 and source.flags & _ALL_INVALID:
            values[:] = np.nan
        return values

    def _find_source(self, channel: MdfChannel) -> Any:
        return self._mdf.groups[channel.group].channels[channel.index]

    def _read_raw(
        self, k: int, rows: int, channels: Sequence[MdfChannel]
    ) -> dict[MdfChannel, tuple[np.ndarray, np.ndarray]]:
        """Return the raw values (rows,) of stored channels of group `k`, and their invalidation masks, in one pass.

        A mask is (0,) if no sample is invalid.
        """
        group = self._mdf.groups[k]
        self._check_data(channels[0], group, rows)
        pieces: dict[MdfChannel, list[tuple[np.ndarray, np.ndarray]]] = {channel: [] for channel in channels}
        done = 0
        with self._reading():
            for fragment in (
                self._mdf._mdf._load_data(group) if rows else ()
            ):  # without rows it yields fragments endlessly
                for channel in channels:
                    values, invalid = self._get(channel, data=fragment)
                    none = np.zeros(len(values), bool)
                    pieces[channel].append((values.copy(), none if invalid is None else np.asarray(invalid, bool)))
                done += len(values)
                if done >= rows or not len(values):
                    break
        raw = {}
        for channel, parts in pieces.items():
            parts = parts or [(np.zeros(0), np.zeros(0, bool))]
            with self._reading():
                values, invalid = (np.concatenate([np.zeros(0, bool), *those]) for those in zip(*parts, strict=True))
            if not values.shape == invalid.shape == (rows,) or values.dtype.kind not in "iufb":
                raise make_damage_error(
                    self._path, f"{channel.name} has {rows} rows by its header, and {len(values)} in its data"
                )
            raw[channel] = (values, invalid)
        return raw

    def _get(self, channel: MdfChannel, **part: Any) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the raw values of a part of a channel, and a mask of the invalid ones."""
        values: tuple[np.ndarray, np.ndarray | None] = self._mdf.get(
            group=channel.group, index=channel.index, raw=True, samples_only=True, ignore_invalidation_bits=True, **part
        )
        return values

    def read_ends(self, channel: MdfChannel) -> tuple[float, float]:
        """Return the first and last value of a channel, without reading those between; NaN if that fails."""
        group = self._mdf.groups[channel.group]
        rows = int(group.channel_group.cycles_nr)
        source = group.channels[channel.index]
        values = []
        try:
            self._check_data(channel, group, rows, inflate=False)
            for row in (0, rows - 1):
                with self._reading():
                    virtual = is_virtual(source, self.version)
                    raw = np.array([row]) if virtual else self._get(channel, record_offset=row, record_count=1)[0]
                values.append(float(self._convert_to_physical(channel, raw, np.zeros(len(raw), bool))[0]))
        except (InputError, ValueError, IndexError):
            return nan, nan
        return values[0], values[1]

    def _check_data(self, channel: MdfChannel, group: Any, rows: int, inflate: bool = True) -> None:
        """Raise InputError if the rows of a group need more data than the file has, or if data do not inflate."""
        block = group.channel_group
        row_bytes = block.samples_byte_nr + (block.invalidation_bytes_nr if self.version == 4 else 0)
        infos = list(group.get_data_blocks())
        size = sum(info.original_size for info in infos)
        if getattr(group, "uses_ld", False):
            row_bytes = block.samples_byte_nr  # invalidation bytes are in separate blocks
        if rows * row_bytes > size:
            raise make_damage_error(
                self._path,
                f"{channel.name} has {rows} rows of {row_bytes} bytes by its header, and {size} bytes of data",
            )
        if not inflate:
            return
        self._check_packed(channel, infos)

    def _check_packed(self, channel: MdfChannel, infos: Sequence[Any]) -> None:
        """Raise InputError for blocks of a channel that do not inflate, or to too much."""
        packed = [info for info in infos if info.block_type in (1, 2) and not info.location]  # deflated, in this file
        size = sum(info.original_size for info in packed)
        if size > _MOST_INFLATED:
            raise InputError(
                f"recording {self._path}: the data of {channel.name} become {size / 2**30:.3g} GiB; allowed are"
                f" {_MOST_INFLATED / 2**30:.3g} GiB"
            )
        for info in packed:
            self._stream.seek(info.address)
            check_inflated(self._path, self._stream.read(info.compressed_size), info.original_size, info.address)

    def _start(self) -> str:
        """Return the time of day of time 0 in ISO 8601; "" if the file has none."""
        try:
            start = self._mdf.header.start_time
        except (ValueError, OverflowError, OSError):
            return ""
        return start.isoformat() if start.year > 1980 else ""  # writers without a clock write 1970 or 1980

    def _start_stamp(self) -> float:
        """Return the time stamp of time 0 [s], in the time base of bus logger frames."""
        try:
            return float(self._mdf.header.start_time.timestamp())
        except (ValueError, OverflowError, OSError):
            return 0.0

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        """Convert exceptions of asammdf in a `with` block to InputError."""
        with quiet():
            try:
                yield
                return
            except InputError:
                raise
            except Exception as error:  # asammdf raises many exception types
                reason = tell_reason(error)
        raise InputError(f"recording {self._path} cannot be read: {reason[:_LONGEST_REASON]}")


def _close(*files: Any) -> None:
    with quiet():
        for file in files:
            with contextlib.suppress(Exception):
                file.close()
