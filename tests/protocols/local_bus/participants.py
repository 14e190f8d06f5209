"""Participants of a local bus for the tests: other processes, and frames."""

import json
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

PATIENCE_S = 10.0
IMPORTS = """
import json, os, struct, sys, time
import can
from protocols.buses.local_bus import LocalBus
from protocols.buses.local_channel import LocalChannel
def tell(value): print(json.dumps(value), flush=True)
def asked(): return sys.stdin.readline().strip()
def numbered(number): return struct.pack("=IB3xQ", 0x100, 8, number)
"""


class Process:
    """Another Python process: `tell(x)` there is `list_heard()` here, `ask(x)` here is `asked()` there."""

    def __init__(self, script: str, *arguments: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, "-c", IMPORTS + textwrap.dedent(script), *arguments],
            cwd=Path(__file__).parents[3], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def ask(self, text: str = "") -> None:
        assert self.popen.stdin
        self.popen.stdin.write(text + "\n")
        self.popen.stdin.flush()

    def list_heard(self) -> Any:
        assert self.popen.stdout
        return json.loads(self.popen.stdout.readline())


def make_frame(number: int, identifier: int = 0x100) -> bytes:
    return identifier.to_bytes(4, "little") + b"\x08\0\0\0" + number.to_bytes(8, "little")
