"""Shared definitions of the bench's processes: CAN frames, buses, clocks, parameter files, records, run files."""

import os
import sys

# Set before numpy is imported: BLAS threads spin on the cores of the real-time loops, and do not speed up small matrices
# (fits of reproductions took 34 s instead of 4 s beside other work).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class _WithoutMf4:
    """Import rule: python-can does not find asammdf.

    Its MF4 logger imports asammdf, and with it pandas, if they are installed. It is not used here: a second and 200 MB in every
    service. python-can itself is imported where it is used, which takes 0.1 s.
    """

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> None:
        if name == "asammdf":
            logger = sys.modules.get("can.io.mf4")
            if logger and getattr(logger.__spec__, "_initializing", False):  # set by Python while it runs a module
                raise ModuleNotFoundError(f"No module named {name!r} for python-can", name=name)


sys.meta_path.insert(0, _WithoutMf4)
