"""Fault cases: one fault each, on a slipping clutch, and the required outcome.

An entry has the form of `[[inject]]` in a scenario (docs/scenarios.md), except for its time.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from plant_sim.bus_faults.bus_fault import COMMANDS, SAMPLES
from plant_sim.node.plant_cycle import FAULT_TOLERANT_TIME

AT = 1.5  # s at which a fault begins; the torque has settled since 0.7 s
SECONDS = 3.0  # s of a run
DEMAND = 10.0  # Nm
_BORNE_HIGHEST = 13.0  # Nm: highest torque with a gap of 9 ms or a delay of 10 ms
_HIGHEST = 16.0  # Nm, highest torque at a demand of 10 Nm before the safe state
# Nm, with the 9.9 V of a masquerade, which the controller's guard would not pass: the highest demand of a supervisor
_MASQUERADE_HIGHEST = 30.0
_MS = 1e-3  # s
STEADY = "time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,10.47\n0.2,0,10.47\n0.5,10,10.47\n10,10,10.47\n"
# Demand that changes continuously, without which a frozen sensor looks normal: highest 15 Nm
STEPPED = (
    "time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,10.47\n0.2,0,10.47\n0.5,10,10.47\n1.2,15,10.47\n1.6,15,10.47\n"
    "2.0,5,10.47\n2.4,12,10.47\n2.8,6,10.47\n3.2,12,10.47\n10,12,10.47\n"
)


@dataclass(frozen=True)
class Borne:
    """The fault is tolerated: the torque follows its demand, up to `highest` [Nm]; no fault is reported."""

    highest: float = _BORNE_HIGHEST


@dataclass(frozen=True)
class Safe:
    """The valve closes permanently within `within` [s] of the fault, and the clutch opens; torque at most `highest` [Nm]."""

    within: float = FAULT_TOLERANT_TIME
    highest: float = _HIGHEST


@dataclass(frozen=True)
class Either:
    """Random outcome: tolerated or safe; torque at most `highest` [Nm]."""

    highest: float = _BORNE_HIGHEST


@dataclass(frozen=True)
class RunEnds:
    """The run ends with an error, and closes the valve within `within` [s] of the fault; the samples before are recovered."""

    within: float = 1.0  # s: `up` checks the rings every 50 ms, and its services need time to end


@dataclass(frozen=True)
class PlantGone:
    """The plant is killed: no valve is left to close, and the recording reaches up to the kill."""


Outcome = Borne | Safe | Either | RunEnds | PlantGone


@dataclass(frozen=True)
class FaultCase:
    """A fault by its entries of a scenario, each with `at` in s after AT, and its outcome.

    profile: CSV of the profile. seconds: length of the run.
    """

    name: str
    entries: tuple[Mapping[str, Any], ...]
    outcome: Outcome
    profile: str = STEADY
    seconds: float = SECONDS

    @property
    def stops(self) -> bool:
        """Whether the case stops or kills a process, so that a long wait is not a disturbance."""
        return any("process" in entry for entry in self.entries)

    @property
    def live(self) -> bool:
        """Whether the case needs processes."""
        return any(set(entry) & {"process", "host_fault"} for entry in self.entries)

    @property
    def needs_interface(self) -> bool:
        """Whether the case needs a SocketCAN bus."""
        return any(entry.get("host_fault") == "interface_down" for entry in self.entries)


def list_fault_cases() -> list[FaultCase]:
    """Return all cases; their names are unique."""
    return [*_list_losses(), *_list_delays(), *_list_orders(), *_list_contents(), *_list_senders(), *_list_sensors(),
            *_list_processes(), *_list_hosts()]  # fmt: skip


def _case(fault: str, outcome: Outcome, until: float = inf, ramp: float = 0.0, **values: float) -> FaultCase:
    """Return a case with a bus fault with these values that ends `until` [s] after it began."""
    entry: dict[str, Any] = {"bus_fault": fault, "values": values, "ramp": ramp} | (
        {"until": until} if until < inf else {}
    )
    words = [f"{name} {value:g}" for name, value in values.items()]
    words += [f"for {1e3 * until:g} ms"] if until < inf else []
    words += [f"along {ramp:g} s"] if ramp else []
    return FaultCase(f"{fault}: {', '.join(words)}", (entry,), outcome)


def _list_losses() -> Iterator[FaultCase]:
    for share in (0.01, 0.1):
        yield _case("frame_loss", Borne(), commands=share)
    for share in (0.3, 0.5, 0.7):
        yield _case("frame_loss", Either(), commands=share)
    yield _case("frame_loss", Borne(), samples=0.01)
    for share in (0.1, 0.3):
        yield _case("frame_loss", Either(), samples=share)
    for values in ({COMMANDS: 1.0}, {SAMPLES: 1.0}, {COMMANDS: 1.0, SAMPLES: 1.0}):
        yield _case("frame_loss", Safe(), **values)
        yield _case("frame_loss", Borne(), until=3.0 * _MS, **values)
        for gap in (25.0, 70.0):
            yield _case("frame_loss", Safe(), until=gap * _MS, **values)
    yield _case("frame_loss", Borne(), until=9.0 * _MS, commands=1.0)
    yield _case("frame_loss", Safe(), until=9.0 * _MS, samples=1.0)
    yield _case("bus_off", Borne(), length=2.0)
    for length in (25.0, 100.0):
        yield _case("bus_off", Safe(), length=length)


def _list_delays() -> Iterator[FaultCase]:
    for delay in (2.0, 5.0, 9.0, 10.0):
        yield _case("frame_delay", Borne(), commands=delay)
    for delay in (2.0, 4.0):
        yield _case("frame_delay", Borne(), samples=delay)
    yield _case("frame_delay", Borne(), commands=4.0, samples=4.0)
    for delay in (20.0, 50.0):
        yield _case("frame_delay", Safe(), commands=delay)
        yield _case("frame_delay", Safe(), samples=delay)
    for direction in (COMMANDS, SAMPLES):  # 10 ms are reached after 0.1 s
        yield _case("frame_delay", Safe(0.11 + FAULT_TOLERANT_TIME), ramp=1.0, **{direction: 100.0})


def _list_orders() -> Iterator[FaultCase]:
    for direction in (COMMANDS, SAMPLES):
        for share in (0.3, 1.0):
            yield _case("frame_repetition", Borne(), **{direction: share})
            # five frames out of sequence in short order are a second sender
            yield _case("frame_repetition", Safe(0.05), **{direction: share}, after=1.0)
        yield _case("frame_repetition", Safe(0.02), **{direction: 1.0}, after=5.0)
        for share in (0.003, 0.03):
            yield _case("frame_reordering", Borne(), **{direction: share})
        yield _case("frame_reordering", Safe(0.1), **{direction: 0.3})
        for renewed in (0.0, 1.0):  # 200 ms pass before the first old frame
            yield _case("frame_replay", Safe(0.2 + 2 * FAULT_TOLERANT_TIME), **{direction: 1.0}, renewed=renewed)


def _list_contents() -> Iterator[FaultCase]:
    for direction in (COMMANDS, SAMPLES):
        for share in (0.01, 0.1):
            yield _case("frame_corruption", Borne(), **{direction: share})
        yield _case("frame_corruption", Either(), **{direction: 0.5})
        yield _case("frame_corruption", Safe(), **{direction: 1.0})
        yield _case("frame_truncation", Borne(), **{direction: 0.1})
        yield _case("frame_truncation", Safe(), **{direction: 1.0})
        for share in (0.1, 1.0):
            yield _case("frame_misaddressing", Borne(), **{direction: share})


def _list_senders() -> Iterator[FaultCase]:
    for direction in (COMMANDS, SAMPLES):
        for count in (1.0, 10.0, 50.0):
            yield _case("frame_insertion", Borne(), **{direction: count})
            yield _case("error_frames", Borne(), **{direction: count})
        for count in (1.0, 20.0):
            yield _case("bus_babbling", Borne(), **{direction: count})
    yield _case("bus_babbling", Borne(), commands=20.0, samples=20.0)
    for ahead in (0.0, 1.0):
        yield _case("frame_masquerade", Safe(0.006, _MASQUERADE_HIGHEST), valve_voltage=9.9, ahead=ahead)
        # 50 ms until the next claim, from which the second sender takes the session; before, its frames are not accepted
        yield _case("frame_masquerade", Safe(0.06), torque_demand=30.0, ahead=ahead)
        yield _case("frame_masquerade", Borne(), torque_demand=30.0, ahead=ahead, claimed=0.0)
        yield _case("frame_masquerade", Safe(0.008), pressure_error=-0.9, ahead=ahead)
    yield _case("heartbeat_rate", Safe(0.155), rate=500.0)


def _list_sensors() -> Iterator[FaultCase]:
    sensors = "pressure", "temperature", "motor_torque", "encoder"
    every = tuple({"freeze": name} for name in sensors)
    yield FaultCase("all sensors stand", every, Safe(0.25, 20.0), STEPPED)
    yield FaultCase("pressure and oil temperature stand", every[:2], Safe(0.6, 20.0), STEPPED)
    yield FaultCase("encoder and motor torque stand", every[2:], Safe(0.5, 26.0), STEPPED)
    for degrees in (-100.0, 100.0):
        entry = {"bias": {"temperature": degrees}}
        yield FaultCase(f"oil temperature {degrees:+g} K", (entry,), Safe())


def _list_processes() -> Iterator[FaultCase]:
    yield FaultCase("controller killed", ({"process": "controller", "signal": "kill"},), Safe())
    for length in (0.2, 0.5):
        entry = {"process": "controller", "signal": "stop", "until": length}
        yield FaultCase(f"controller stopped for {length:g} s", (entry,), Safe())
    yield FaultCase("controller stopped", ({"process": "controller", "signal": "stop"},), Safe())
    yield FaultCase("plant killed", ({"process": "plant", "signal": "kill"},), PlantGone())
    entry = {"process": "plant", "signal": "stop", "until": 0.3}
    yield FaultCase("plant stopped for 0.3 s", (entry,), Safe(0.3 + FAULT_TOLERANT_TIME))


def _list_hosts() -> Iterator[FaultCase]:
    yield FaultCase("disk full", ({"host_fault": "disk_full"},), RunEnds())
    slow = {"host_fault": "disk_slow", "values": {"delay": 500.0}}
    yield FaultCase("disk slow", (slow,), Borne())
    for step in (-3600.0, 3600.0):
        entry = {"host_fault": "clock_step", "values": {"step": step}, "until": 1.0}
        yield FaultCase(f"time of day {step:+g} s for 1 s", (entry,), Borne())
    down = {"host_fault": "interface_down"}
    yield FaultCase("interface down for 0.5 s", (down | {"until": 0.5},), Safe())
    yield FaultCase("interface down", (down,), Safe())
    peers: tuple[tuple[str, str, dict[str, float]], ...] = (
        ("request_flood", "request_flood", {}),
        ("request_flood, unknown names", "request_flood", {"unknown": 1.0}),
        ("rubbish_peer", "rubbish_peer", {}),
    )
    for name, fault, values in peers:  # each begins about 1 s after it was started
        yield FaultCase(name, ({"host_fault": fault, "values": values},), Borne(), seconds=SECONDS + 3.0)
