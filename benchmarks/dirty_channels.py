"""Dirty channels: valid runs with one channel altered, as by wrong maps, dead sensors and other clocks.

    python -m benchmarks.dirty_channels          # every alteration of every channel, and 200 sound cases of the battery

A check must report each altered case, and the engine must name no wrong effect in a case that passes the checks. No hard check
may report a valid case, whatever real sensor fault it contains.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

from benchmarks.battery.cases import Case, list_cases
from benchmarks.battery.records import generate_case
from benchmarks.battery.short_case import make_short_case
from benchmarks.battery.truth_laws import CATALOGUE_LAWS
from clutch_hil.bench.progress import progress_bar
from clutch_hil.command import run_command
from clutch_hil.discrepancy.models.pneumatic_cylinder import PneumaticCylinder
from clutch_hil.discrepancy.models.position_axis import PositionAxis
from clutch_hil.discrepancy.models.sliding_contact import SlidingContact
from clutch_hil.discrepancy.models.tribometer import Tribometer
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.discrepancy.result import NAMED, ONE_OF
from clutch_hil.discrepancy.search import investigate
from clutch_hil.fitting.model import Columns, Model
from clutch_hil.fitting.run_checks import check_evidence
from protocols.errors import InputError, suggest_closest

Alteration = Callable[[np.ndarray, float], np.ndarray]  # values (n,) and sample period [s] -> values (n,)

_LATE = 0.5  # s that a channel is shifted by
_FACTORS = {  # unit -> other units of a channel, and their number in one of our units
    "bar": {"psi": 14.504, "kPa": 100.0, "MPa": 0.1, "Pa": 1e5},
    "degc": {},
    "nm": {"kgf cm": 10.197, "Ncm": 100.0},
    "n": {"kN": 1e-3, "mN": 1e3, "kgf": 0.10197},
    "rad_s": {"rpm": 9.5493, "deg/s": 57.296, "Hz": 0.15915},
    "rad": {"deg": 57.296, "revolutions": 0.15915},
    "v": {"mV": 1e3},
    "m": {"mm": 1e3, "cm": 100.0, "inch": 39.37, "dm": 10.0, "sixteenths": 16.0},
}
# their zero is the position when the encoder was switched on
_FREE_ZERO = "shaft_angle_rad", "position_m", "displacement_m"


def _freeze(x: np.ndarray, _: float) -> np.ndarray:
    return np.where(np.arange(len(x)) < len(x) // 2, x, x[len(x) // 2])


def _shift(x: np.ndarray, period: float) -> np.ndarray:
    return np.roll(x, round(_LATE / period))


ALTERATIONS: Mapping[str, Alteration] = {
    "dead at 0": lambda x, _: np.zeros_like(x),
    "dead at its mean": lambda x, _: np.full_like(x, x.mean()),
    "sign": lambda x, _: -x,
    "times 1000": lambda x, _: 1e3 * x,
    "times 0.001": lambda x, _: 1e-3 * x,
    "frozen": _freeze,
    "saturated above": lambda x, _: np.minimum(x, x.min() + 0.5 * np.ptp(x)),
    "saturated below": lambda x, _: np.maximum(x, x.min() + 0.5 * np.ptp(x)),
    "late": _shift,
    "off": lambda x, _: x + max(np.ptp(x), abs(x.mean())),
}


def list_alterations(column: str) -> dict[str, Alteration]:
    """Return the alterations of a column by name: those of every column, and those of its unit."""
    unit = next(u for u in sorted(_FACTORS, key=len, reverse=True) if column.endswith(f"_{u}"))
    alterations = dict(ALTERATIONS) | {f"in {n}": (lambda x, _, f=f: f * x) for n, f in _FACTORS[unit].items()}
    if unit == "degc":
        alterations |= {"in K": lambda x, _: x + 273.15, "in degF": lambda x, _: 1.8 * x + 32.0}
    if column in _FREE_ZERO:
        del alterations["off"]
    if unit == "degc":
        del alterations["late"]  # a thermometer lags by seconds: temperature_sensor_lag
    return alterations


@dataclass(frozen=True)
class DirtyCase:
    """A rig, its valid runs, and the channels to alter."""

    model: Model
    runs: Mapping[str, Columns]
    channels: tuple[str, ...]

    def alter_each_channel(self) -> Iterator[tuple[str, str, dict[str, Columns]]]:
        """Yield channel, alteration and altered runs, for each channel in turn."""
        for column in self.channels:
            for name, change in list_alterations(column).items():
                yield column, name, self.alter(column, change)

    def alter(self, column: str, change: Alteration) -> dict[str, Columns]:
        """Return the runs with one channel altered in all of them."""
        return {
            name: {**run, column: change(run[column], float(run["time_s"][1] - run["time_s"][0]))}
            for name, run in self.runs.items()
        }


def make_wet_clutch(seed: int = 1) -> DirtyCase:
    """Return the short runs of the battery's rig with nothing hidden."""
    fitted, held_out = make_short_case({}, seed=seed)
    model = WetClutch()
    return DirtyCase(model, fitted | held_out, tuple(c for c in model.run_columns if c != "time_s"))


def make_position_axis(seed: int = 1) -> DirtyCase:
    """Return the strokes of an axis like that of EMPS: 95 kg, 20 N, 200 Ns/m, three speeds, at 250 Hz."""
    model, random = PositionAxis(), np.random.default_rng(seed)
    values = {n: p.value for n, p in model.parameters.items()} | {
        "table.mass": 95.0, "friction.coulomb": 20.0, "friction.viscous": 200.0, "motor.delay": 0.3,
    }  # fmt: skip
    runs = {}
    for k, speed in enumerate((0.04, 0.08, 0.12)):
        time = np.arange(0.0, 16.0, 4e-3)
        wanted = speed * np.clip(3.0 * np.sin(2.0 * np.pi * 0.25 * time + k), -1.0, 1.0)
        smooth = np.convolve(np.pad(wanted, 25, "edge"), np.hanning(51) / np.hanning(51).sum(), "valid")
        position = np.cumsum(smooth) * 4e-3
        run = {"time_s": time, "position_m": position + 1e-6 * random.standard_normal(len(time))}
        force = model.simulate({**run, "position_m": position}, values, {})["motor_force_n"]
        runs[f"run-{k}"] = run | {"motor_force_n": force + 0.4 * random.standard_normal(len(time))}
    return DirtyCase(model, runs, ("position_m", "motor_force_n"))


def make_tribometer(seed: int = 1) -> DirtyCase:
    """Return strokes of 1 mm to and fro under a load that varies between 2 and 8 N, at 1 kHz; each sensor has noise."""
    runs = {}
    for k, frequency in enumerate((0.5, 1.0, 2.0)):
        time = np.arange(0.0, 12.0, 1e-3)
        path = 5e-4 * np.sin(2.0 * np.pi * frequency * time + k)
        load = 5.0 + 3.0 * np.sin(2.0 * np.pi * 0.2 * time + 2.0 * k)
        runs[f"run-{k}"] = {"time_s": time, "displacement_m": path, "normal_load_n": load}
    return _record(Tribometer(), runs, (1e-8, 0.02, 0.01), seed)


def make_pneumatic_cylinder(seed: int = 1) -> DirtyCase:
    """Return strokes of 30 mm against a pressure that varies between 1 and 5 bar, at 500 Hz; each sensor has noise."""
    runs = {}
    for k, frequency in enumerate((0.1, 0.2, 0.3)):
        time = np.arange(0.0, 20.0, 2e-3)
        position = 0.015 * np.sin(2.0 * np.pi * frequency * time + k)
        pressure = 3.0 + 2.0 * np.sin(2.0 * np.pi * 0.13 * time + 2.0 * k)
        runs[f"run-{k}"] = {"time_s": time, "position_m": position, "pressure_bar": pressure}
    return _record(PneumaticCylinder(), runs, (2e-6, 0.005, 0.3), seed)


def _record(
    model: SlidingContact, inputs: Mapping[str, Columns], noise: tuple[float, float, float], seed: int
) -> DirtyCase:
    """Return noisy inputs and the baseline's force; `noise`: standard deviations of the inputs and the output.

    The force belongs to the inputs as measured: otherwise the noise at a reversal looks like pre-sliding or a delay.
    """
    random, output = np.random.default_rng(seed), model.output.column
    runs = {}
    for name, exact in inputs.items():
        errors = random.standard_normal((len(noise), len(exact["time_s"])))
        run = {"time_s": exact["time_s"]} | {
            column: exact[column] + size * error
            for column, size, error in zip(model.inputs, noise[:-1], errors[:-1], strict=True)
        }
        force = model.simulate(run, {n: p.value for n, p in model.parameters.items()}, {})[output]
        runs[name] = run | {output: force + noise[-1] * errors[-1]}
    return DirtyCase(model, runs, (*model.inputs, output))


_FITTING = {  # effects equal to an alteration: naming them is correct
    ("cylinder_pressure_bar", "saturated above"): ("sensor_saturation",),
    ("clutch_torque_nm", "saturated above"): ("sensor_saturation",),
    ("clutch_torque_nm", "saturated below"): ("sensor_saturation",),
    ("clutch_torque_nm", "off"): ("torque_sensor_offset",),
    ("cylinder_pressure_bar", "off"): ("pressure_sensor_offset",),
    ("rod_force_n", "off"): ("torque_sensor_offset",),
}


def name_wrong(case: DirtyCase, column: str, alteration: str, runs: Mapping[str, Columns]) -> tuple[str, list[str]]:
    """Return the engine's verdict on runs that passed the checks, and the wrong effects that it names."""
    result = investigate(case.model, runs)
    named = result.effects if result.verdict == NAMED else [n for group in result.alternatives for n in group]
    right = _FITTING.get((column, alteration), ())
    return result.verdict, [name for name in named if name not in right] if result.verdict in (NAMED, ONE_OF) else []


def list_sound_cases(most: int) -> list[Case]:
    """Return at most `most` cases of the battery with a real sensor fault, of both splits, sizes and noise levels."""
    sensors = {law.name for law in CATALOGUE_LAWS if law.block == "sensors"}
    listed = [c for split in ("development", "evaluation") for c in list_cases(split, ("single", "warm", "closed"))]
    chosen = [c for c in listed if c.effects and c.effects[0] in sensors]
    order = np.random.default_rng(30).permutation(len(chosen))
    return [chosen[i] for i in order[:most]]


def make_sliding_cases(seeds: int) -> Iterator[tuple[str, DirtyCase]]:
    """Yield valid runs of the rigs with a sliding contact: without effects, and with each effect at its typical size."""
    for rig in ("position_axis", "tribometer", "pneumatic_cylinder"):
        for seed in range(1, seeds + 1):
            case = CASES[rig](seed)
            values = {n: p.value for n, p in case.model.parameters.items()}
            column, floor = case.model.outputs[0].column, {}
            for name, run in case.runs.items():
                floor[name] = run[column] - case.model.simulate(run, values, {})[column]
            yield f"{rig}, seed {seed}", case
            for candidate in case.model.candidates:
                runs = {
                    name: {
                        **run,
                        column: case.model.simulate(run, values, candidate.list_typical_values())[column] + floor[name],
                    }
                    for name, run in case.runs.items()
                }
                yield f"{rig}, {candidate.name}, seed {seed}", DirtyCase(case.model, runs, case.channels)


def list_refusals(case: Case) -> list[str]:
    """Return the reports of the hard checks on a valid case."""
    generated = generate_case(case)
    runs = {f"run-{k}": one.columns for k, one in enumerate((*generated.runs, *generated.held_out))}
    return [str(finding) for finding in check_evidence(WetClutch(), runs) if finding.hard]


CASES: Mapping[str, Callable[[], DirtyCase]] = {
    "wet_clutch": make_wet_clutch, "position_axis": make_position_axis, "tribometer": make_tribometer,
    "pneumatic_cylinder": make_pneumatic_cylinder,
}  # fmt: skip


def main(
    sound: Annotated[int, typer.Option(min=0, help="sound cases of the battery")] = 200,
    sliding_seeds: Annotated[int, typer.Option(min=0, help="sound runs with each effect of a sliding contact")] = 2,
    only: Annotated[str, typer.Option(help="one rig; all if not given")] = "",
    fits: Annotated[bool, typer.Option(help="whether the engine is asked about what the checks let pass")] = True,
) -> None:
    """Alter every channel, ask the checks, and the engine where they let it pass; then count sound cases that are refused."""
    if only and only not in CASES:
        raise InputError(f"--only is {only!r}, which is no rig here; {suggest_closest(only, CASES)}")
    silent, wrong, cases, hard = [], [], 0, 0
    for rig, make in CASES.items():
        if only and only != rig:
            continue
        case = make()
        if sentences := [str(f) for f in check_evidence(case.model, case.runs)]:
            typer.echo(f"{rig}: sound runs: {sentences}")
        for column, alteration, runs in case.alter_each_channel():
            cases += 1
            findings = check_evidence(case.model, runs)
            refuses = any(f.hard for f in findings)
            hard += refuses
            line = f"{rig}: {column} {alteration}: {'refused' if refuses else 'told' if findings else 'SILENT'}"
            if not findings:
                silent.append(line)
            if fits and not refuses:
                verdict, named = name_wrong(case, column, alteration, runs)
                line += f", {verdict} {named or ''}"
                wrong += [line] if named else []
            typer.echo(f"{line}: {findings[0] if findings else '-'}")
    listed, refusals = list_sound_cases(sound), []
    with progress_bar("sound cases", False) as progress:
        for done, sound_case in enumerate(listed):
            progress(done, len(listed))
            if sentences := list_refusals(sound_case):
                refusals.append(f"{sound_case.name}: {sentences[0]}")
                typer.echo(refusals[-1])
    sliding, count = 0, 0
    for name, sliding_case in make_sliding_cases(sliding_seeds):
        findings = check_evidence(sliding_case.model, sliding_case.runs)
        sliding, count = sliding + 1, count + bool(findings)
        if findings:
            typer.echo(f"{name}: {'refused' if findings[0].hard else 'told'}: {findings[0]}")
        if any(f.hard for f in findings):
            refusals.append(name)
    typer.echo(f"sound sliding contacts: {sliding}, of which {count} are told something")
    typer.echo(
        f"verdict: of {cases} altered cases {hard} are refused, {len(silent)} passed in silence, {len(wrong)} named wrong;"
        f" of {len(listed) + sliding} sound ones {len(refusals)} are refused"
    )
    raise typer.Exit(1 if silent or wrong or refusals else 0)


if __name__ == "__main__":
    run_command(main)
