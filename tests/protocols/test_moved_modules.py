"""Old names of modules: where each is now."""

from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

from plant_sim.node.plant_node import RIG, PlantNode
from protocols import moved_modules
from protocols.errors import InputError
from protocols.moved_modules import describe_moves, find_new_place


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("plant_sim.discrepancy", "clutch_hil.discrepancy"),
        ("plant_sim.discrepancy.model", "clutch_hil.fitting.model"),
        ("plant_sim.discrepancy.decide", "clutch_hil.discrepancy.decision"),
        ("plant_sim.discrepancy.models.slide", "clutch_hil.discrepancy.models.sliding_contact"),
        ("clutch_hil.discrepancy.inquiry", "clutch_hil.discrepancy.selection"),
        ("clutch_hil.live.rrd", "clutch_hil.live.viewer.rrd_reader"),
        ("clutch_hil.live.tune", "clutch_hil.live.tuning.tune"),  # commands/tune.py has the same file name
        ("plant_sim.bench.measures", "clutch_hil.bench.judgement.measures"),
        ("plant_sim.palette", "clutch_hil.bench.pictures.palette"),
        ("plant_sim.scenario", "clutch_hil.bench.scenario"),
        ("plant_sim.profile", "plant_sim.profiles.profile"),
        ("plant_sim.effects.friction_lag", "plant_sim.effects.friction.friction_lag"),
        ("protocols.runs", "protocols.files.runs"),
        ("rt_controller.adaptation", "rt_controller.law.adaptation"),
        ("clutch_hil.discrepancy.model", "clutch_hil.fitting.model"),
        ("clutch_hil.fitting.model", None),  # it is there
        ("plant_sim.discrepancy.no_such", None),
        ("protocols.no_such", None),
        ("numpy.no_such", None),
        ("clutch_hil", None),
    ],
)
def test_a_module_is_where_it_is_said_to_be(old: str, new: str | None) -> None:
    assert find_new_place(old) == new
    if new:
        assert find_spec(new)


def test_every_place_in_the_tables_exists_and_no_old_name_does() -> None:
    for table in (moved_modules._PACKAGES, moved_modules._MODULES):
        for old, new in table.items():
            assert find_new_place(old) == new


@pytest.mark.parametrize("package", ["plant_sim", "clutch_hil"])
def test_a_renamed_class_is_told(package: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(f"from {package}.discrepancy.models.slide import Slide\n", encoding="utf-8")
    place = "clutch_hil.discrepancy.models.sliding_contact.SlidingContact"
    assert find_spec(place.rpartition(".")[0])
    assert (
        describe_moves(ImportError("No module"), file) == f"; {package}.discrepancy.models.slide.Slide is now {place}"
    )


def test_a_module_imported_from_its_package_is_told(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("from clutch_hil.discrepancy import atlas_numbers\n", encoding="utf-8")
    assert describe_moves(ImportError("cannot import name"), file) == (
        "; clutch_hil.discrepancy.atlas_numbers is now clutch_hil.discrepancy.residual_statistics"
    )


@pytest.mark.parametrize("old", [name for name in moved_modules._NAMES if not name.endswith(".Slide")])
def test_a_renamed_function_is_told(old: str, tmp_path: Path) -> None:
    module, _, name = old.rpartition(".")
    new = moved_modules._NAMES[old]
    place, _, function = new.rpartition(".")
    assert callable(getattr(import_module(place), function))
    sentence = f"; {old} is now {new}"
    with pytest.raises(AttributeError) as lacking:
        getattr(import_module(module), name)
    assert describe_moves(lacking.value) == sentence
    with pytest.raises(ImportError) as not_imported:
        exec(f"from {module} import {name}")
    assert describe_moves(not_imported.value) == sentence
    file = tmp_path / "mine.py"
    file.write_text(f"from {module} import {name}\n", encoding="utf-8")
    assert describe_moves(not_imported.value, file) == sentence


MOVED_NAMES = {  # of modules that are folders now, and of modules that gave a part to another one
    "clutch_hil.live.viewer.Viewer": "clutch_hil.live.viewer.viewer.Viewer",
    "clutch_hil.live.viewer.WebViewer": "clutch_hil.live.viewer.viewer.WebViewer",
    "clutch_hil.live.viewer.PAGE_PORT": "clutch_hil.live.viewer.viewer.PAGE_PORT",
    "clutch_hil.live.monitor.watch": "clutch_hil.live.monitor.monitor.watch",
    "protocols.errors.describe_error": "protocols.user_code.describe_error",
    "clutch_hil.live.viewer._WINDOW_MEMORY": None,  # nobody was to import it
    "clutch_hil.live.viewer.NoSuchThing": None,
    "clutch_hil.commands.register": None,  # more than one module has it
}


@pytest.mark.parametrize(("old", "new"), MOVED_NAMES.items())
def test_a_name_that_moved_out_of_its_module_is_told(old: str, new: str | None, tmp_path: Path) -> None:
    module, _, name = old.rpartition(".")
    if new:
        place, _, moved = new.rpartition(".")
        assert hasattr(import_module(place), moved)
    sentence = f"; {old} is now {new}" if new else ""
    file = tmp_path / "mine.py"
    file.write_text(f"import {module}\nfrom {module} import {name}\nfrom protocols.errors import InputError\n", "utf-8")
    with pytest.raises(ImportError) as not_imported:
        exec(f"from {module} import {name}")
    assert describe_moves(not_imported.value) == sentence
    assert describe_moves(not_imported.value, file) == sentence
    with pytest.raises(AttributeError) as lacking:
        getattr(import_module(module), name)
    assert describe_moves(lacking.value) == sentence


def test_a_node_with_an_old_method_is_refused() -> None:
    class Old(PlantNode):
        def cycle(self, inbox: object, count: int) -> int:
            return 0

    with pytest.raises(InputError, match=r"node of the rig mine: its method cycle\(\) is called run_cycle\(\) now"):
        replace(RIG, name="mine", node=Old)


def test_another_error_has_nothing_to_do_with_it(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("from protocols.runs import Run\n", encoding="utf-8")
    assert describe_moves(ValueError("wrong"), file) == ""
    assert describe_moves(ImportError(name="protocols.runs"), tmp_path / "mine.py") == (
        "; protocols.runs is now protocols.files.runs"
    )
