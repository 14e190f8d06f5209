"""What the processes of the bench must agree on: CAN frames, buses, clocks, parameter files, records, run files."""

import os

# Before numpy is imported: threads of the BLAS spin on the cores of the real-time loops, and small matrices gain nothing
# by them (fits of reproductions took 34 s instead of 4 s beside other work).
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
