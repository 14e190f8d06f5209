"""What the processes of the bench must agree on: CAN frames, buses, clocks, parameter files, records, run files."""

import os
import sys

# Before numpy is imported: threads of the BLAS spin on the cores of the real-time loops, and small matrices gain nothing
# by them (fits of reproductions took 34 s instead of 4 s beside other work).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# python-can imports asammdf where it is installed, and with it pandas, for an MF4 logger that is not used here: a second
# and 200 MB in every service. While python-can is imported, asammdf is not there.
if "asammdf" not in sys.modules:
    sys.modules["asammdf"] = None  # type: ignore[assignment]
    import can  # noqa: F401

    del sys.modules["asammdf"]
