"""Labels of an HDF5 file: names and units that stand beside its numbers, in attributes and in datasets of text."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from clutch_hil.recordings.channel import is_time_name
from clutch_hil.recordings.hdf5_file import Hdf5File
from clutch_hil.recordings.stated_unit import list_unit_keys

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


class Labels:
    """Names and units of the datasets of an open file. What groups say is read once."""

    def __init__(self, file: Hdf5File) -> None:
        self._file = file
        self._beside: dict[str, Mapping[str, str]] = {}  # by the name of a group: units of its datasets

    def find_unit(self, data: "h5py.Dataset", column: int = 0, count: int = 1, field: str = "") -> str:
        """The unit of a column, or of the `field` of that number, of `count` ones; "" where none is told.

        It is told by an attribute, one for all or one for each column, or stands beside the dataset, in its group.
        """
        keys = list(data.attrs)
        for key in list_unit_keys(keys):
            texts = self._file.read_texts(data, key)
            if len(texts) == 1 < count:
                parted = [text.strip() for text in texts[0].split(",")]
                texts = parted if len(parted) == count else texts
            if len(texts) == count > 1:
                return texts[column]
            if len(texts) == 1 and not field:
                return texts[0]
        if field:
            own = _choose_own(keys, (field, f"field_{column}"))
            return self._file.read_attribute(data, *own)
        return self._read_beside(data.parent).get(data.name.rpartition("/")[2], "")

    def list_names(self, data: "h5py.Dataset", count: int) -> Sequence[str]:
        """Names of the `count` columns of a dataset; none where no attribute has a different one for each."""
        for key in data.attrs:
            if key.lower() in _NAMES and len({*(texts := self._file.read_texts(data, key))} - {""}) == count:
                return texts
        return []

    def _read_beside(self, group: "h5py.Group") -> Mapping[str, str]:
        """Units of the datasets of a group: `x_unit` beside `x`, and `unit` beside the one that holds no times."""
        if group.name not in self._beside:
            members = self._file.list_members(group)
            arrays = [name for name, entry in members if _is_array(entry)]
            texts = {name: self._file.read_text(entry) for name, entry in members if _is_text(entry)}
            texts |= {key: self._file.read_attribute(group, key) for key in list(group.attrs)}
            own = _choose_all_own(list(texts), arrays)
            units = {name: texts[key] for name, key in own.items()}
            alone = [texts[key] for key in list_unit_keys(texts)]
            valued = [name for name in arrays if not is_time_name(name)] or arrays
            if len(valued) == 1 and alone:
                units.setdefault(valued[0], alone[0])
            self._beside[group.name] = {name: unit for name, unit in units.items() if unit}
        return self._beside[group.name]


def _choose_own(keys: Sequence[str], stems: Sequence[str]) -> list[str]:
    """Those of `keys` that tell a unit behind one of the `stems`, as `torque_unit` does."""
    return [
        key
        for key in keys
        for stem in stems
        if key.lower().startswith(f"{stem.lower()}_") and list_unit_keys([key[len(stem) + 1 :]])
    ]


def _choose_all_own(keys: Sequence[str], stems: Sequence[str]) -> dict[str, str]:
    """Which of `keys` tells the unit of each of the `stems`, as `torque_unit` does that of `torque`."""
    by_stem = {stem.lower(): stem for stem in stems}
    told = ((key, *key.lower().rpartition("_")[::2]) for key in keys)
    return {by_stem[stem]: key for key, stem, end in told if stem in by_stem and list_unit_keys([end])}


def _is_array(entry: Any) -> bool:
    import h5py

    return isinstance(entry, h5py.Dataset) and entry.shape is not None and entry.size > 1 and entry.dtype.kind in "fiub"


def _is_text(entry: Any) -> bool:
    import h5py

    return (
        isinstance(entry, h5py.Dataset)
        and entry.shape is not None
        and entry.size == 1
        and h5py.check_string_dtype(entry.dtype) is not None
    )
