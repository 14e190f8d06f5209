"""Scenario files for the tests."""

from collections.abc import Callable
from pathlib import Path

from typer.testing import CliRunner

from clutch_hil.command import make_application

SHORT = "time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,10\n0.1,0,10\n0.3,8,10\n1.0,8,10\n"
FULL = """
title = "Everything"
about = "All there is."
rig = "wet_clutch"
[run]
profile = "short.csv"
seconds = 0.9
rate = 500
seed = 3
temperature = 50
law = "feedforward"
adaptation = false
[plant.valve]
gain = 2.4
[controller.pressure]
proportional_gain = 0.5
[effects]
piston_seal_friction = { force = 50 }
friction_level = {}
[[inject]]
at = 0.5
ramp = 0.1
until = 0.7
effect = "internal_leakage"
values = { conductance = 1e-6 }
bias = { pressure = 0.1 }
[[inject]]
at = 0.6
effect = "friction_level"
off = true
[[inject]]
at = 0.65
parameters = { "oil.sump_temperature" = 80 }
freeze = "temperature"
[limits]
rise_time_s = { most = 0.5 }
peak_torque_nm = { least = 7, most = 12.5 }
"""


def make_writer(folder: Path) -> Callable[[str], Path]:
    """Writes a scenario into `folder`, beside a short profile; its path."""
    (folder / "short.csv").write_text(SHORT)

    def write(text: str) -> Path:
        path = folder / "case.toml"
        path.write_text(text)
        return path

    return write


def invoke_command(*arguments: object):
    return CliRunner().invoke(make_application(), [str(argument) for argument in arguments])


RUN = '\n[run]\nprofile = "short.csv"\n'
