"""`python -m protocols` is `clutch-hil`, for starting services from the same interpreter."""

from protocols.command import main

main()
