"""Groups and channels of an open MDF 3 or 4 file: those with a number or a text in each row, and why others are left out."""

from dataclasses import dataclass
from typing import Any

from protocols.files.mdf.conversions import NUMBER, STATUS, TEXT, find_kind
from protocols.files.mdf.frames import holds_frames

# Quantity of an MDF 4 master channel, by its number in the file
MASTERS = ("unknown", "time", "angle", "distance", "index")
BUS_MESSAGES = "messages of a bus, not signals"  # why a group is left out
MAY_BE_INVALID = 2  # MDF 4: flag of a channel
_MASTER_4, _VIRTUAL_MASTER_4, _VIRTUAL_4 = 2, 3, 6  # MDF 4: types of a channel
_MASTER_3 = 1  # MDF 3: type of a channel
VALUE_TYPES_4 = (0, _MASTER_4, _VIRTUAL_MASTER_4, _VIRTUAL_4)  # those that hold one value a row
_NUMBERS_4, _TEXTS_4 = range(6), range(6, 10)  # MDF 4: data types of whole and real numbers; of text
_NUMBERS_3, _TEXTS_3 = (0, 1, 2, 3, 9, 10, 11, 12, 13, 14, 15, 16), (7,)  # MDF 3: the same
_VARIABLE = 1  # MDF 4: flag of a group that holds the values of a channel of varying length


@dataclass(frozen=True)
class MdfChannel:
    """A channel without its values. group, index: place in the file. kind: number, status or text.

    master: its quantity (MASTERS) if it is the master of its group, else "". unit, comment: as in the file. bits: of a raw
    value.
    """

    group: int
    index: int
    name: str
    unit: str
    comment: str
    kind: str
    master: str = ""
    bits: int = 64


@dataclass(frozen=True)
class MdfGroup:
    """Channels with `rows` samples each. master: the channel over which the others are recorded, or None.

    number: number of the group that has the master, from 0; groups with the same number share their rows.
    """

    number: int
    name: str
    rows: int
    channels: tuple[MdfChannel, ...]
    master: MdfChannel | None = None


class GroupList:
    """Groups of an open file of asammdf. left_out: names of channels without a number or text in each row, by reason."""

    def __init__(self, mdf: Any, version: int) -> None:
        self._mdf, self._version = mdf, version
        self.left_out: dict[str, list[str]] = {}
        self.groups = [group for k in range(len(mdf.groups)) if (group := self._make_group(k))]

    def _make_group(self, k: int) -> MdfGroup | None:
        """Return group `k`; None if it is not readable as signals: bus messages, values of varying length."""
        group = self._mdf.groups[k]
        block = group.channel_group
        rows, name, number = int(block.cycles_nr), "", k
        master_at = self._mdf.masters_db.get(k)
        if self._version == 4:
            name = block.acq_name or ""
            if block.flags & _VARIABLE:
                return None
            if holds_frames(group):
                self._leave_out(BUS_MESSAGES, name or f"group {k + 1}")
                return None
            number = self._mdf.virtual_groups_map.get(k, k)
        channels = tuple(c for i in range(len(group.channels)) if (c := self._make_channel(k, i, i == master_at)))
        if number != k:
            master_group = self._mdf.groups[number]
            rows = min(rows, int(master_group.channel_group.cycles_nr))
            at = self._mdf.masters_db.get(number)
            master = None if at is None else self._make_channel(number, at, True)
        else:
            master = next((c for c in channels if c.master), None)
        return MdfGroup(number, name, rows, channels, master)

    def _make_channel(self, group_at: int, index: int, is_master: bool) -> MdfChannel | None:
        group = self._mdf.groups[group_at]
        channel = group.channels[index]
        name = channel.name or f"channel {index + 1}"
        if group.channel_dependencies[index]:
            self._leave_out("arrays or structures", name)
            return None
        numbers, texts = (_NUMBERS_4, _TEXTS_4) if self._version == 4 else (_NUMBERS_3, _TEXTS_3)
        if channel.data_type in texts and not is_master:
            kind = TEXT
        elif channel.data_type not in numbers or (self._version == 4 and channel.channel_type not in VALUE_TYPES_4):
            self._leave_out("bytes, dates or samples of varying length", name)
            return None
        else:
            kind = find_kind(channel.conversion, self._version)
            if kind == NUMBER and channel.bit_count == 1 and channel.conversion is None:
                kind = STATUS
            if not is_virtual(channel, self._version) and not _is_inside(group.channel_group, channel, self._version):
                self._leave_out("outside of its record", name)
                return None
        unit = getattr(channel, "unit", "") or getattr(channel.conversion, "unit", "") or ""
        comment = channel.comment or ""
        master = self._name_master(channel, is_master)
        kind = NUMBER if master else kind
        return MdfChannel(group_at, index, name, unit.strip(" \0"), comment, kind, master, channel.bit_count)

    def _name_master(self, channel: Any, is_master: bool) -> str:
        if not is_master:
            return ""
        if self._version == 3:
            return "time"
        kind = channel.sync_type
        return MASTERS[kind] if kind < len(MASTERS) else MASTERS[0]

    def _leave_out(self, reason: str, name: str) -> None:
        self.left_out.setdefault(reason, []).append(name)


def is_virtual(channel: Any, version: int) -> bool:
    """Return whether a channel counts rows instead of being stored."""
    if version == 3:
        return bool(channel.channel_type == _MASTER_3 and channel.bit_count == 0)
    return channel.channel_type in (_VIRTUAL_MASTER_4, _VIRTUAL_4)


def _is_inside(block: Any, channel: Any, version: int) -> bool:
    """Return whether a channel lies inside its record: a C library reads it unchecked."""
    if version == 3:
        bits = channel.start_offset + 8 * getattr(channel, "additional_byte_offset", 0) + channel.bit_count
        return 0 < channel.bit_count <= 64 and bits <= 8 * block.samples_byte_nr
    bits = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
    if channel.flags & MAY_BE_INVALID and channel.pos_invalidation_bit >= 8 * block.invalidation_bytes_nr:
        return False
    return 0 < channel.bit_count <= 64 and bits <= 8 * block.samples_byte_nr
