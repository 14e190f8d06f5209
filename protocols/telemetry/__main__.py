"""The telemetry process of a service; the service starts it by python -m protocols.telemetry RING FOLDER."""

import argparse
import shutil
import sys
from pathlib import Path

from protocols.errors import InputError
from protocols.telemetry import READY
from protocols.telemetry.publisher import publish


def main() -> int:
    """Publish the record of a service over zenoh; return the exit code, 2 where it cannot be published."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("ring", type=Path, help="ring of the service")
    parser.add_argument("folder", type=Path, help="folder of the service with its mailbox; removed at the end")
    parser.add_argument("--terminal", type=int, help="descriptor that faults are written to")
    parser.add_argument("--router", help="zenoh router, for example tcp/192.168.1.5:7447")
    asked = parser.parse_args()
    try:
        publish(asked.ring, asked.folder / "mailbox", asked.router, (asked.folder / READY).touch, asked.terminal)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    finally:
        shutil.rmtree(asked.folder, ignore_errors=True)  # the service may have been killed
    return 0


if __name__ == "__main__":
    sys.exit(main())
