"""Blocks of an MDF file, checked link by link before a reader follows them: no circles, none outside the file, limited sizes.

A file that was cut within its rows is read up to the cut: `open_checked` gives a copy that ends there. This is done only if no
other block follows the cut.

Source: ASAM MDF 4.2, section 6 (blocks); MDF 3.3, section 4. A reader that follows links unchecked can loop
for ever if one link is wrong.
"""

import mmap
import shutil
import struct
import tempfile
from pathlib import Path
from typing import IO

from protocols.errors import InputError
from protocols.files.mdf.walk import ID_BYTES, Condition, make_damage_error
from protocols.files.mdf.walk_version_3 import Mdf3Walk
from protocols.files.mdf.walk_version_4 import Mdf4Walk

FINISHED, UNFINISHED = b"MDF     ", b"UnFinMF "  # first bytes of a file


def open_checked(path: Path) -> tuple[IO[bytes], Condition]:
    """Return a file whose blocks are sound, and its condition; a temporary copy if parts must be rewritten.

    Raises InputError for blocks that a reader cannot handle.
    """
    condition = check_blocks(path)
    if not condition.unfinished and not condition.mends:
        return path.open("rb"), condition
    copy = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as its reader is; asammdf finishes what it reads
    with path.open("rb") as file:
        shutil.copyfileobj(file, copy)
    for place, content in condition.mends:
        copy.seek(place)
        copy.write(content)
    copy.seek(0)
    return copy, condition


def check_blocks(path: Path) -> Condition:
    """Check all blocks of a file. Raises InputError for blocks that a reader cannot handle."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        if len(content) < ID_BYTES + 4:
            raise InputError(
                f"recording {path} cannot be read: it is an MDF file that was cut after {len(content)} bytes"
            )
        condition = Condition(content[:8] != FINISHED)
        try:
            if content[ID_BYTES : ID_BYTES + 4] == b"##HD":
                Mdf4Walk(path, content, condition).check()
            elif content[ID_BYTES : ID_BYTES + 2] == b"HD":
                Mdf3Walk(path, content, condition).check()
            else:
                raise make_damage_error(path, "it has no header")
        except struct.error:
            raise make_damage_error(path, "a block is not whole") from None
        return condition
