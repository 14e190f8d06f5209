"""`python -m clutch_hil` is `clutch-hil`, for starting services from the same interpreter."""

from clutch_hil.command import main

main()
