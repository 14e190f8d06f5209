"""What the processes of the bench must agree on: CAN frames, buses, clocks, parameter files, records, run files."""
