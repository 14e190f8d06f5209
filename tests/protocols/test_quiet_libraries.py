"""What other people's readers say of a file stays off the terminal, whenever they say it; others are heard."""

import gc
import logging
import subprocess
import sys
import warnings

import pytest

from protocols.files.quiet_libraries import quiet

SCRIPT = """
from protocols.files.quiet_libraries import quiet

class HalfOpen:
    def __del__(self):
        raise AttributeError("'MDF4' object has no attribute '_file'")

with quiet():
    pass
HalfOpen.__del__.__module__ = "{module}"
half = [HalfOpen()]
half.append(half)
{end}
"""


@pytest.mark.parametrize("end", ["del half; import gc; gc.collect()", ""], ids=["collected", "at the exit"])
@pytest.mark.parametrize(("module", "heard"), [("asammdf.blocks.mdf_v4", False), ("my_package.reader", True)])
def test_a_half_open_object_says_nothing(end: str, module: str, heard: bool) -> None:
    script = SCRIPT.format(module=module, end=end)
    sentence = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True)
    assert (sentence.stdout, bool(sentence.stderr)) == ("", heard)


def test_logs_warnings_and_prints_are_not_seen(capfd: pytest.CaptureFixture[str]) -> None:
    log = logging.getLogger("nptdms.reader")
    handler = logging.StreamHandler()
    log.addHandler(handler)
    try:
        with quiet():
            log.warning("Segment version mismatch")
            warnings.warn("a deprecated file", DeprecationWarning, stacklevel=1)
            print("remark")
        gc.collect()
        assert capfd.readouterr() == ("", "")
        log.warning("heard again")
        assert "heard again" in capfd.readouterr().err
    finally:
        log.removeHandler(handler)
