"""Telemetry: publishes every row of every service over zenoh, at no cost to the loop.

service --shared-memory ring--> its telemetry process (`publisher.py`) --zenoh--> viewers, monitors, recorders (`feed.py`)
service <--mailbox-- its telemetry process <--query-- `clutch-hil tune` (`tuning.py`)

Keys and encodings: `keys.py`, `batch.py`. Each service has its own telemetry process, so that a controller on a real rig
publishes as it does on the bench.
"""

READY = "ready"  # file in the folder of a service: its telemetry process creates it once it publishes
