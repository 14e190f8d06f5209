"""Scenario: a run, the changes made to it and the limits that judge it, from a TOML file (docs/scenarios.md)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

from clutch_hil.bench.arguments import take_whole
from clutch_hil.bench.faults.bench_fault import BenchFault
from clutch_hil.bench.faults.catalogue import PlannedHostFault
from clutch_hil.bench.faults.process_fault import ProcessFault
from clutch_hil.bench.judgement.demand_check import check_demands
from clutch_hil.bench.limits import Limit
from clutch_hil.bench.rig import DEFAULT_RIG, Rig, find_rig
from clutch_hil.bench.settings import RunSettings, take_settings
from clutch_hil.command import check_rate
from plant_sim.bus_faults.catalogue import BUS_FAULTS
from plant_sim.effects.catalogue import load_effects
from plant_sim.node.injection import Injection, bias_sensor, freeze_sensor, switch_off, switch_on
from plant_sim.node.plant_rig import RigProfile
from plant_sim.profiles.profile import list_profiles
from protocols.can.bus_load import BITRATES, compute_bus_load
from protocols.can.frames import list_bus_frames
from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError, join_names, name_file_in_errors, suggest_closest
from protocols.files.parameters import ParameterSet, load_overlay
from protocols.files.toml_table import TomlTable, read_table

FOLDER = Path(__file__).with_name("scenarios")

_ENTRIES = ("title", "about", "rig", "run", "plant", "controller", "effects", "inject", "limits")
_RUN_ENTRIES = {
    "profile": str, "seconds": float, "rate": int, "seed": int, "temperature": float, "law": str, "adaptation": bool,
}  # fmt: skip
_BENCH_ENTRIES = {
    "process": ("signal",),
    "host_fault": ("values",),
}  # faults of the bench, and what may be combined with them
_INJECT_ENTRIES = (
    "at", "ramp", "until", "clutch", "effect", "bus_fault", "process", "signal", "host_fault", "values", "off", "parameters",
    "freeze", "bias",
)  # fmt: skip


@dataclass(frozen=True)
class Scenario:
    """A run of a rig.

    plant: parameters of the plant, with the effects that are on. injections: changes of the plant and faults of the bus during
    the run. bench_faults: of its processes and the computer, for runs with separate processes only. limits: judge the
    run. path: file of the scenario, None for a run without a file.
    """

    name: str
    title: str
    about: str
    rig: Rig
    path: Path | None
    settings: RunSettings
    plant: ParameterSet
    injections: tuple[Injection, ...] = ()
    bench_faults: tuple[BenchFault, ...] = ()
    limits: tuple[Limit, ...] = ()

    @classmethod
    def of(cls, settings: RunSettings, rig: str = DEFAULT_RIG) -> "Scenario":
        """Return a scenario with `settings` only, without injections and limits. Raises InputError."""
        name, known = Path(settings.profile).name.removesuffix(".csv"), find_rig(rig)
        return cls(name, "", "", known, None, settings, known.plant.load_parameters(settings.plant_parameters))

    @property
    def duration(self) -> float:
        """Return the length of its profile [s]. Raises InputError."""
        return self.load_profile().duration

    def load_profile(self) -> RigProfile:
        """Load the profile to play, of the class of the rig. Raises InputError, also for an injection after its end."""
        profile = self.rig.plant.make_profile(self.settings.profile, self.settings.seconds)
        begins = [(f"inject {number}", one.at) for number, one in enumerate(self.injections, 1)]
        begins += [(f"the fault {one.what!r}", one.at) for one in self.bench_faults]
        for what, begin in begins:
            if begin >= profile.duration:
                raise InputError(
                    f"{what} begins at {begin:g} s, when the run of {profile.duration:g} s is over;"
                    " allowed are earlier times"
                )
        return profile

    def make_controllers(self, profile: RigProfile | None) -> dict[str, Any]:
        """Make its controllers, by name. Raises InputError, also where a controller cannot follow a set-point of `profile`.

        profile: None where the demand comes over the bus.
        """
        controllers = {}
        for name, clutch in self.rig.plant.controllers.items():
            controllers[name] = self.settings.make_controller(clutch)
            check_demands(profile, controllers[name].parameters, clutch)
        return controllers


def find_shipped_scenarios() -> dict[str, Path]:
    """Return the files of the shipped scenarios, by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("[!.]*.toml"))}  # without lock files of an editor


def load_scenario(name: str, given: Mapping[str, Any] | None = None) -> Scenario:
    """Load a shipped scenario by name, or a TOML file by its path. `given` overrides fields of its RunSettings.

    Raises InputError, which names file, entry, value and allowed values.
    """
    known = find_shipped_scenarios()
    path = Path(name) if name.endswith(".toml") else known.get(name)
    if path is None:
        if name.endswith(".csv") or name in list_profiles():
            raise InputError(f"scenario {name!r} is a profile; give it by --profile {name}, or profile= from Python")
        raise InputError(
            f"scenario {name!r} is unknown, and the path of one ends with .toml; {suggest_closest(name, known)}"
        )
    with name_file_in_errors("scenario", path):
        table = read_table(path, _ENTRIES)
        rig = find_rig(table.get("rig", str, DEFAULT_RIG))
        settings = replace(_read_settings(table, rig), **(given or {}))
        return Scenario(
            name=path.stem,
            title=table.need("title", str),
            about=table.get("about", str, "").strip(),
            rig=rig,
            path=path,
            settings=settings,
            plant=_read_plant(table, rig, settings.plant_parameters),
            injections=tuple(_read_injections(table, rig)),
            bench_faults=tuple(_read_bench_faults(table, rig)),
            limits=_read_limits(table, rig),
        )


def check_seed(seed: Any, name: str = "seed") -> int:
    """Return `seed` if it is a valid seed of random numbers. Raises InputError."""
    return take_whole(name, seed, 0)


def choose_scenario(name: str | None, given: Mapping[str, Any], rig: str | None = None) -> Scenario:
    """Load the scenario `name`; if it is None, make one of `rig`. Fields of RunSettings in `given` that are not None override.

    Raises InputError.
    """
    settings = take_settings(given)
    check_rate(settings.get("rate", RunSettings.rate))
    if name is None:
        return Scenario.of(RunSettings(**settings), rig or DEFAULT_RIG)
    loaded = load_scenario(name, settings)
    if rig not in (None, loaded.rig.name):
        raise InputError(
            f"scenario {name} is for the rig {loaded.rig.name}, but --rig {rig} was given; leave one of them out"
        )
    return loaded


def _read_settings(table: TomlTable, rig: Rig) -> RunSettings:
    run = table.read_subtable("run", tuple(_RUN_ENTRIES))
    entries = {key: run.get(key, kind) for key, kind in _RUN_ENTRIES.items() if key in run}
    rate = check_rate(entries.get("rate", RunSettings.rate))
    if (load := compute_bus_load(list_bus_frames(clutches=len(rig.plant.controllers)), rate, max(BITRATES))) > 1.0:
        raise InputError(
            f"run.rate is {rate} Hz: its frames would fill {100 * load:.0f} % of a bus of {max(BITRATES) // 1000} kbit/s;"
            " allowed are 100 %"
        )
    check_seed(entries.get("seed", RunSettings.seed), "run.seed")
    if entries.get("profile", "").endswith(".csv"):
        entries["profile"] = str(table.path.parent / entries["profile"])
    return RunSettings(**entries, controller=table.read_subtable("controller").read_numbers())


def _read_plant(table: TomlTable, rig: Rig, changed: Path | None) -> ParameterSet:
    given = table.read_subtable("plant").read_numbers()
    plant = rig.plant.load_parameters().with_values(given)
    clutches = rig.plant.clutches
    effects = table.read_subtable("effects", clutches or None)
    parts = {f"{clutch}.": effects.read_subtable(clutch) for clutch in clutches} or {"": effects}
    for prefix, part in parts.items():
        for name in part:
            if name in BUS_FAULTS:
                raise InputError(f"effects.{name} is a fault of the bus; it is allowed in [[inject]], as bus_fault")
            if any(entry.startswith(f"{prefix}{name}.") for entry in given):
                raise InputError(f"effect {prefix}{name} is in both [plant] and [effects]; only one of them is allowed")
            plant = plant.with_values(_add_prefix(prefix, switch_on(name, part.read_subtable(name).read_numbers())))
    return load_overlay(changed, plant, rig=rig.name) if changed else plant


def _read_injections(table: TomlTable, rig: Rig) -> Iterator[Injection]:
    for entry in table.read_subtables("inject", _INJECT_ENTRIES):
        if set(entry) & set(_BENCH_ENTRIES):
            continue
        if "signal" in entry:
            raise InputError(f"{entry.name} has signal without process; add process")
        prefix = ""
        if rig.plant.clutches and set(entry) & {"effect", "freeze", "bias"}:
            if (clutch := entry.need("clutch", str)) not in rig.plant.clutches:
                raise InputError(f"{entry.name}.clutch is {clutch!r}; allowed are {', '.join(rig.plant.clutches)}")
            prefix = f"{clutch}."
        values = _add_prefix(prefix, _read_changes(entry)) | entry.read_subtable("parameters").read_numbers()
        times = entry.need("at", float), entry.get("ramp", float, 0.0), entry.get("until", float, inf)
        try:
            yield Injection(values, *times)
        except InputError as error:
            raise InputError(f"{entry.name}: {error}") from None


def _read_bench_faults(table: TomlTable, rig: Rig) -> Iterator[BenchFault]:
    for entry in table.read_subtables("inject", _INJECT_ENTRIES):
        kinds = [kind for kind in _BENCH_ENTRIES if kind in entry]
        if not kinds:
            continue
        kind, beside = kinds[0], ("at", "until", *_BENCH_ENTRIES[kinds[0]])
        if stray := sorted(set(entry) - {kind, *beside}):
            raise InputError(f"{entry.name} has {kind} and {stray[0]}; allowed with it are {join_names(beside)}")
        at, until, name = entry.need("at", float), entry.get("until", float, inf), entry.need(kind, str)
        if name in CONTROLLERS and name not in rig.plant.controllers:
            raise InputError(f"{entry.name}.process is {name!r}; the rig {rig.name} has one controller")
        try:
            if kind == "process":
                yield ProcessFault(name, entry.get("signal", str, "kill"), at=at, until=until)
            else:
                yield PlannedHostFault(name, entry.read_subtable("values").read_numbers(), at=at, until=until)
        except InputError as error:
            raise InputError(f"{entry.name}: {error}") from None


def _read_changes(entry: TomlTable) -> dict[str, float]:
    """Return the parameters of effects, sensors and bus faults that an entry of `inject` changes, with their values."""
    values: dict[str, float] = {}
    switched = [key for key in ("effect", "bus_fault") if key in entry]
    if len(switched) == 2:
        raise InputError(f"{entry.name} has both effect and bus_fault; only one of them is allowed")
    if switched:
        name, off = entry.get(switched[0], str), entry.get("off", bool, False)
        if (name in BUS_FAULTS) != (switched == ["bus_fault"]):
            known = BUS_FAULTS if switched == ["bus_fault"] else load_effects()
            raise InputError(f"{entry.name}.{switched[0]} is {name!r}; {suggest_closest(name, known)}")
        if off and "values" in entry:
            raise InputError(
                f"{entry.name} has both off and values of {switched[0]} {name}; only one of them is allowed"
            )
        values |= switch_off(name) if off else switch_on(name, entry.read_subtable("values").read_numbers())
    elif stray := [key for key in ("values", "off") if key in entry]:
        raise InputError(f"{entry.name} has {stray[0]} without effect; add effect")
    if "freeze" in entry:
        values |= freeze_sensor(entry.get("freeze", str))
    for sensor, bias in entry.read_subtable("bias").read_numbers().items():
        values |= bias_sensor(sensor, bias)
    return values


def _read_limits(table: TomlTable, rig: Rig) -> tuple[Limit, ...]:
    entries = table.read_subtable("limits")
    limits = []
    for name in entries:
        if rig.measure(name).words:
            limits.append(Limit(rig, name, equal=entries.get(name, str)))
        else:
            limit = entries.read_subtable(name, ("least", "most"))
            limits.append(Limit(rig, name, limit.get("least", float), limit.get("most", float)))
    if limits and "fault" not in entries:
        limits.append(Limit(rig, "fault", equal="none"))
    return tuple(limits)


def _add_prefix(prefix: str, values: Mapping[str, float]) -> dict[str, float]:
    return {f"{prefix}{name}": value for name, value in values.items()}
