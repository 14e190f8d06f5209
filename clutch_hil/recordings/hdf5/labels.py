"""Labels of an HDF5 file: names and units of its datasets, from attributes and text datasets."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from clutch_hil.recordings.channel import is_time_name
from clutch_hil.recordings.hdf5.file import Hdf5File
from clutch_hil.recordings.stated_unit import join_units, list_unit_keys

if TYPE_CHECKING:
    import h5py

# Attributes with a name for each column of a dataset, in lower case
_NAMES = (
    "columns",
    "column_names",
    "names",
    "labels",
    "channels",
    "channel_names",
    "signals",
    "signal_names",
    "fields",
)
_MARKS = (",", ";", "\t", "|")  # separators of names or units in one text


class Labels:
    """Names and units of the datasets of an open file. Labels in groups are read once."""

    def __init__(self, file: Hdf5File) -> None:
        self._file = file
        self._lists: dict[str, Mapping[str, list[str]]] = {}  # by group name: lists of names and units
        self._named: dict[str, dict[str, str]] = {}  # by group name: units from its group of units
        self._beside: dict[str, Mapping[str, str]] = {}  # by group name: units of its datasets

    def find_unit(self, data: "h5py.Dataset", column: int = 0, count: int = 1, field: str = "") -> str:
        """Return the unit of column `column` of `count` columns, or of the `field` with this number; "" if none is stated.

        It is stated in an attribute, one for all columns or one for each, or beside the dataset in its group.
        """
        keys = list(data.attrs)
        alone = []
        for key in list_unit_keys(keys):
            texts = _part(self._file.read_texts(data, key), count)
            if len(texts) == count > 1:
                return texts[column]
            if len(texts) == 1 and not field:
                alone += texts
        if alone:
            return join_units(alone)
        if count > 1 and not field:
            lists = self._read_lists(data.parent)
            parted = [_part(lists[key], count) for key in list_unit_keys(lists)]
            if fitting := [texts for texts in parted if len(texts) == count]:
                return fitting[0][column]
        if field:
            own = _choose_own(keys, (field, f"field_{column}"))
            return self._file.read_attribute(data, *own)
        return self._read_beside(data.parent).get(data.name.rpartition("/")[2], "")

    def list_names(self, data: "h5py.Dataset", count: int) -> Sequence[str]:
        """Return the names of the `count` columns of a dataset; empty where no attribute or list has a different one for
        each."""
        names = {key: _part(self._file.read_texts(data, key), count) for key in data.attrs if key.lower() in _NAMES}
        lists = self._read_lists(data.parent)
        names |= {key: _part(texts, count) for key, texts in lists.items() if key.lower() in _NAMES}
        stem, _, end = data.name.rpartition("/")[2].rpartition("_")
        names |= {key: texts for key, texts in lists.items() if end == "values" and key == f"{stem}_items"}  # of pandas
        return next((texts for texts in names.values() if len(texts) == count == len({*texts} - {""})), [])

    def _read_lists(self, group: "h5py.Group") -> Mapping[str, list[str]]:
        """Return the lists of names and units that are attributes of a group, or datasets in it."""
        if group.name not in self._lists:
            keys = [key for key in group.attrs if key.lower() in _NAMES or list_unit_keys([key])]
            self._lists[group.name] = {key: self._file.read_texts(group, key) for key in keys} | {
                name: self._file.read_text_list(entry)
                for name, entry in self._file.list_members(group)
                if (name.lower() in _NAMES or name.endswith("_items") or list_unit_keys([name])) and _is_text(entry, 1)
            }
        return self._lists[group.name]

    def _read_beside(self, group: "h5py.Group") -> Mapping[str, str]:
        """Return units of the datasets of a group: `x_unit` for `x`, and `unit` for the only one that is not a time."""
        if group.name not in self._beside:
            members = self._file.list_members(group)
            arrays = [name for name, entry in members if _is_array(entry)]
            texts = {name: self._file.read_text(entry) for name, entry in members if _is_text(entry)}
            texts |= {key: self._file.read_attribute(group, key) for key in list(group.attrs)}
            own = _choose_all_own(list(texts), arrays)
            named = self._read_group_of_units(group) | self._read_group_of_units(group.parent)
            units = {name: named[name] for name in arrays if name in named}
            units |= {name: texts[key] for name, key in own.items()}
            alone = [texts[key] for key in list_unit_keys(texts)]
            valued = [name for name in arrays if not is_time_name(name)] or arrays
            if len(valued) == 1 and alone:
                units.setdefault(valued[0], alone[0])
            self._beside[group.name] = {name: unit for name, unit in units.items() if unit}
        return self._beside[group.name]

    def _read_group_of_units(self, group: "h5py.Group") -> dict[str, str]:
        """Return units by dataset name, from the subgroup `units` of a group."""
        import h5py

        if group.name not in self._named:
            groups = {name: entry for name, entry in self._file.list_members(group) if isinstance(entry, h5py.Group)}
            members = [one for key in list_unit_keys(groups)[:1] for one in self._file.list_members(groups[key])]
            self._named[group.name] = {name: self._file.read_text(entry) for name, entry in members if _is_text(entry)}
        return self._named[group.name]


def _part(texts: list[str], count: int) -> list[str]:
    """Return the texts; a single one such as `time, torque, speed` is split if this gives `count` parts."""
    for mark in _MARKS if len(texts) == 1 < count else ():
        parted = [text.strip() for text in texts[0].split(mark)]
        if len(parted) == count:
            return parted
    return texts


def _choose_own(keys: Sequence[str], stems: Sequence[str]) -> list[str]:
    """Return those of `keys` that are one of the `stems` followed by a word for unit, as `torque_unit`."""
    return [
        key
        for key in keys
        for stem in stems
        if key.lower().startswith(f"{stem.lower()}_") and list_unit_keys([key[len(stem) + 1 :]])
    ]


def _choose_all_own(keys: Sequence[str], stems: Sequence[str]) -> dict[str, str]:
    """Return for each of the `stems` the one of `keys` that gives its unit, as `torque_unit` for `torque`."""
    by_stem = {stem.lower(): stem for stem in stems}
    parts = ((key, *key.lower().rpartition("_")[::2]) for key in keys)
    return {by_stem[stem]: key for key, stem, end in parts if stem in by_stem and list_unit_keys([end])}


def _is_array(entry: Any) -> bool:
    import h5py

    return isinstance(entry, h5py.Dataset) and entry.shape is not None and entry.size > 1 and entry.dtype.kind in "fiub"


def _is_text(entry: Any, axes: int = 0) -> bool:
    """Return whether a member of a group is a text dataset, or a list of texts where `axes` is 1."""
    import h5py

    return (
        isinstance(entry, h5py.Dataset)
        and entry.shape is not None
        and (entry.size == 1 or len(entry.shape) == axes > 0)
        and h5py.check_string_dtype(entry.dtype) is not None
    )
