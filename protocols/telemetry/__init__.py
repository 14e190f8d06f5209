"""Telemetry: every row of every service over zenoh, for anybody who listens, at no cost to the loop.

service --shared-memory ring--> its telemetry process (`publisher.py`) --zenoh--> viewers, monitors, recorders (`feed.py`)
service <--mailbox-- its telemetry process <--query-- `clutch-hil tune` (`tuning.py`)

Keys and encodings: `keys.py`, `batch.py`. One service has one telemetry process, so that a controller on a real rig is
as visible as the bench.
"""

READY = "ready"  # file in the folder of a service, which its telemetry process makes when it publishes
