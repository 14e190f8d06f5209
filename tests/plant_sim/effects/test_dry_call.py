"""A dry call takes no effect that comes with the bench for a wrong one."""

import re

import numpy as np
import pytest
from numba import from_dtype

from plant_sim.effects import signals
from plant_sim.effects.catalogue import load_effects
from plant_sim.effects.dry_call import call_dry
from plant_sim.rigs import wet_clutch


@pytest.mark.parametrize("name", load_effects())
def test_every_effect_of_the_bench_passes(name: str) -> None:
    values = wet_clutch.list_values(wet_clutch.load_nominal())
    call_dry(load_effects()[name], from_dtype(np.dtype([(field, np.float64) for field in values])), values)


def test_what_a_law_may_change_is_in_the_table_for_readers() -> None:
    table = (signals.__doc__ or "").partition("may change\n")[2].partition("\n\n")[0]
    rows = re.findall(r"^    ([A-Z]+) .{3,60}?  +(\S.*)$", table.replace(",\n" + 54 * " ", ", "), re.MULTILINE)
    assert [hook for hook, _ in rows] == list(signals.HOOKS)
    for hook, text in rows:
        for name in signals.CHANGEABLE[signals.HOOKS.index(hook)]:
            assert name in text or "_voltage" in text or "sensed_" in text, f"{name} at {hook}"
