"""Bounds on the memory that reading a file may allocate, checked from the sizes in the file before allocation."""

from protocols.errors import InputError

# Bytes of memory for one recording: a fifth of the free memory of a small laptop; 24 h at 1 kHz of one column fit
MOST_BYTES = 1 << 30
MOST_ROWS = 50_000_000  # of one column: 14 h at 1 kHz; with 8 bytes a value and one working copy that is 0.8 GB
_COPIES = 3  # of a column that exist at once while it is filtered and resampled


def check_rows(what: str, rows: float, columns: int, advice: str = "") -> None:
    """Raise InputError if `rows` of `columns` numbers, or working copies of them, need more memory than is allowed.

    advice: remedy, as the end of the message.
    """
    remedy = f": {advice}" if advice else ""
    if rows > MOST_ROWS:
        raise InputError(f"{what} {rows:.4g} rows; allowed are {MOST_ROWS:.4g}{remedy}")
    if (size := 8.0 * rows * columns * _COPIES) > MOST_BYTES:
        raise InputError(
            f"{what} {rows:.4g} rows of {columns} columns, which need {size / (1 << 30):.3g} GiB of memory;"
            f" allowed is {MOST_BYTES / (1 << 30):.3g} GiB{remedy}"
        )


def check_bytes(what: str, size: float, advice: str = "") -> None:
    """Raise InputError if `size` bytes are more than is allowed. advice: remedy, as the end of the message."""
    if size > MOST_BYTES:
        remedy = f": {advice}" if advice else ""
        raise InputError(f"{what} {size / (1 << 30):.3g} GiB; allowed is {MOST_BYTES / (1 << 30):.3g} GiB{remedy}")
