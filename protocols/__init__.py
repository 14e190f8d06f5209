"""Shared definitions of the bench's processes: CAN frames, buses, clocks, parameter files, records, run files."""

import os
import sys

# Set before numpy is imported: BLAS threads spin on the cores of the real-time loops, and do not speed up small matrices
# (fits of reproductions took 34 s instead of 4 s beside other work).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# python-can imports asammdf if it is installed, and with it pandas, for an MF4 logger that is not used here: a second and
# 200 MB in every service. So asammdf is hidden while python-can is imported.
if "asammdf" not in sys.modules:
    sys.modules["asammdf"] = None  # type: ignore[assignment]
    import can  # noqa: F401

    del sys.modules["asammdf"]
