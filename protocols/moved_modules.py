"""New places of moved modules and new names of functions of this project, for files of users.

Packages were divided on 2026-11-25, and some modules have other names since. A module that only moved into a subpackage is
found by its file name. The tables list the others.
"""

import ast
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

_PACKAGES = {
    "plant_sim.bench": "clutch_hil.bench",
    "plant_sim.discrepancy": "clutch_hil.discrepancy",
    "plant_sim.live": "clutch_hil.live",
    "plant_sim.reproduce": "clutch_hil.thesis",
    **{f"plant_sim.{name}": f"clutch_hil.bench.{name}" for name in ("direction", "experiments", "scenario")},
    **{f"plant_sim.{name}": f"clutch_hil.bench.pictures.{name}" for name in ("lanes", "palette")},
    "protocols.command": "clutch_hil.command",
}
_MODULES = {
    "clutch_hil.discrepancy.atlas_numbers": "clutch_hil.discrepancy.residual_statistics",
    "clutch_hil.discrepancy.decide": "clutch_hil.discrepancy.decision",
    "clutch_hil.discrepancy.experiment": "clutch_hil.discrepancy.experiment_design",
    "clutch_hil.discrepancy.evidence": "clutch_hil.fitting.evidence",
    "clutch_hil.discrepancy.fit": "clutch_hil.fitting.fit",
    "clutch_hil.discrepancy.intervals": "clutch_hil.fitting.intervals",
    "clutch_hil.discrepancy.model": "clutch_hil.fitting.model",
    "clutch_hil.discrepancy.run_checks": "clutch_hil.fitting.run_checks",
    "clutch_hil.discrepancy.noise": "clutch_hil.fitting.noise",
    "clutch_hil.discrepancy.inquiry": "clutch_hil.discrepancy.selection",
    "clutch_hil.discrepancy.models.slide": "clutch_hil.discrepancy.models.sliding_contact",
    "clutch_hil.discrepancy.models.straight": "clutch_hil.discrepancy.models.linear_motion",
    "clutch_hil.discrepancy.report.experiment": "clutch_hil.discrepancy.report.proposed_experiment",
    "clutch_hil.discrepancy.report.missing": "clutch_hil.discrepancy.report.missing_physics",
    "clutch_hil.discrepancy.report.page": "clutch_hil.discrepancy.report.html_page",
    "clutch_hil.discrepancy.report.remains": "clutch_hil.discrepancy.report.remaining_residual",
    "clutch_hil.discrepancy.report.where": "clutch_hil.discrepancy.report.disagreement",
    "clutch_hil.live.course": "clutch_hil.live.driving.demand_defaults",
    "clutch_hil.live.lathe": "clutch_hil.live.viewer.solids",
    "clutch_hil.live.pace": "clutch_hil.live.viewer.decimator",
    "clutch_hil.live.page": "clutch_hil.live.viewer.viewer_page",
    "clutch_hil.live.record": "clutch_hil.live.recording.bench_recording",
    "clutch_hil.live.replay": "clutch_hil.live.run_replay",
    "clutch_hil.live.rrd": "clutch_hil.live.viewer.rrd_reader",
    "clutch_hil.thesis.contradicted": "clutch_hil.thesis.contradictions",
    "clutch_hil.thesis.page": "clutch_hil.thesis.html_page",
    "clutch_hil.thesis.record": "clutch_hil.thesis.markdown_page",
    "clutch_hil.thesis.result": "clutch_hil.thesis.reproduction",
    "clutch_hil.thesis.sheet": "clutch_hil.thesis.check_sheet",
}
_NAMES = {  # of classes and functions that files of users name
    "clutch_hil.discrepancy.models.sliding_contact.Slide": "clutch_hil.discrepancy.models.sliding_contact.SlidingContact",
    "plant_sim.effects.catalogue.effect": "plant_sim.effects.catalogue.find_effect",
    "plant_sim.effects.catalogue.effects": "plant_sim.effects.catalogue.load_effects",
    "plant_sim.effects.table.table": "plant_sim.effects.table.make_table",
    "plant_sim.rigs.wet_clutch.nominal": "plant_sim.rigs.wet_clutch.load_nominal",
    "plant_sim.rigs.power_shift.nominal": "plant_sim.rigs.power_shift.load_nominal",
    "plant_sim.rigs.position_axis.nominal": "plant_sim.rigs.position_axis.load_nominal",
    "plant_sim.rigs.tribometer.nominal": "plant_sim.rigs.tribometer.load_nominal",
    "plant_sim.friction.coupled.slide": "plant_sim.friction.coupled.simulate_slide",
    "plant_sim.node.injection.effect_on": "plant_sim.node.injection.switch_on",
    "plant_sim.node.injection.effect_off": "plant_sim.node.injection.switch_off",
    "plant_sim.node.injection.sensor_freeze": "plant_sim.node.injection.freeze_sensor",
    "plant_sim.node.injection.sensor_bias": "plant_sim.node.injection.bias_sensor",
    "clutch_hil.bench.pictures.picture.run_sheet": "clutch_hil.bench.pictures.picture.make_run_sheet",
    "clutch_hil.bench.pictures.shift_picture.shift_sheet": "clutch_hil.bench.pictures.shift_picture.make_shift_sheet",
    "clutch_hil.bench.judgement.measures.torque": "clutch_hil.bench.judgement.measures.find_torque",
    "clutch_hil.bench.judgement.measures.faults": "clutch_hil.bench.judgement.measures.list_faults",
    "clutch_hil.fitting.model.equation": "clutch_hil.fitting.model.find_equation",
    "protocols.errors.closest": "protocols.errors.suggest_closest",
    "protocols.errors.listing": "protocols.errors.join_names",
    "protocols.node.record_type": "protocols.node.make_record_type",
    "protocols.node.node_factory": "protocols.node.load_node",
    "plant_sim.friction.model.real": "plant_sim.friction.model.check_real",
    "plant_sim.friction.model.signal": "plant_sim.friction.model.check_signal",
    "plant_sim.friction.model.motion": "plant_sim.friction.model.check_motion",
    "plant_sim.friction.model.elements": "plant_sim.friction.model.check_element_values",
    "clutch_hil.discrepancy.models.linear_motion.candidates": "clutch_hil.discrepancy.models.linear_motion.make_candidates",
}


def describe_moves(error: Exception, path: Path | None = None) -> str:
    """Return the new names of what an `error` lacks, as an addition to its message; '' if nothing was renamed.

    path: the user's file that raised it, if known; then all of its imports are looked up.
    """
    if isinstance(error, AttributeError) and isinstance(error.obj, ModuleType):
        old = f"{error.obj.__name__}.{error.name}"
        place = _NAMES.get(old) or _find_definition(error.obj.__name__, error.name or "")
        return f"; {old} is now {place}" if place else ""
    if not isinstance(error, ImportError):
        return ""
    moves = {}
    lacking = re.match(r"cannot import name '(\w+)'", str(error))
    for module, name in _list_imports(path) if path else [(error.name or "", lacking[1] if lacking else None)]:
        old, place = module, find_new_place(module)
        if renamed := _NAMES.get(f"{place or module}.{name}"):
            old, place = f"{module}.{name}", renamed
        elif name and not place:
            old = f"{module}.{name}"
            place = None if _is_file(module) else find_new_place(old)
            place = place or _find_definition(module, name)
        if place:
            moves[old] = place
    if not moves and error.name and (place := find_new_place(error.name)):
        moves[error.name] = place
    return "".join(f"; {old} is now {new}" for old, new in moves.items())


def find_new_place(module: str) -> str | None:
    """Return the present name of the module or package `module`; None if it has not moved or is unknown."""
    if _is_file(module) or _is_folder(module):
        return None
    place = module
    for table in (_PACKAGES, _MODULES):
        for old, new in table.items():
            if place == old or place.startswith(f"{old}."):
                place = new + place.removeprefix(old)
                break
    if _is_file(place) or _is_folder(place):
        return place
    return _find_by_file_name(place)


def _find_by_file_name(module: str) -> str | None:
    """Return the module whose file has the same name as that of `module`, in the nearest package; None if it is not unique."""
    package, *parts = module.split(".")
    root = _find_folder(package)
    if root is None or not parts:
        return None
    for depth in range(len(parts) - 1, -1, -1):
        same_name = list(root.joinpath(*parts[:depth]).rglob(f"{parts[-1]}.py"))
        if same_name:
            place = same_name[0].relative_to(root).with_suffix("").parts
            return ".".join((package, *place)) if len(same_name) == 1 else None
    return None


def _find_definition(module: str, name: str) -> str | None:
    """Return the new name of what `module` of this project once had; None if it has it, or if no other module defines it.

    The nearest folder with such a definition counts. A folder with the name of a former module prefers the module of that name.
    """
    package, *parts = module.split(".")
    root = _find_folder(package)
    if root is None or name.startswith("_") or _is_file(f"{module}.{name}"):
        return None
    home = root.joinpath(*parts)
    own = home / "__init__.py" if home.is_dir() else home.with_suffix(".py")
    if not own.is_file() or re.search(rf"\b{name}\b", own.read_text(encoding="utf-8")):
        return None
    defines = re.compile(rf"^(?:(?:def|class)\s+{name}\b|{name}\s*[:=])", re.MULTILINE)
    for folder in (home, *home.parents[: len(parts)]) if home.is_dir() else home.parents[: len(parts)]:
        files = [file for file in folder.rglob("*.py") if defines.search(file.read_text(encoding="utf-8"))]
        files = [file for file in files if file.stem == folder.name] or files
        if files:
            place = files[0].relative_to(root).with_suffix("").parts
            return ".".join((package, *place, name)) if len(files) == 1 else None
    return None


def _list_imports(path: Path) -> Iterator[tuple[str, str | None]]:
    """Yield module and name of every absolute import in a Python file; the name is None if the module itself is imported."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from ((node.module, alias.name) for alias in node.names)


def _find_folder(package: str) -> Path | None:
    """Return the folder of a package of this project; None for other packages."""
    if package not in ("clutch_hil", "plant_sim", "protocols", "rt_controller"):
        return None
    spec = find_spec(package)
    return Path(str(spec.origin)).parent if spec and spec.origin else None


def _is_file(module: str) -> bool:
    package, *parts = module.split(".")
    folder = _find_folder(package)
    return bool(folder and parts and folder.joinpath(*parts).with_suffix(".py").is_file())


def _is_folder(module: str) -> bool:
    package, *parts = module.split(".")
    folder = _find_folder(package)
    return bool(folder and folder.joinpath(*parts).is_dir())
