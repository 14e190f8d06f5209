"""One clutch of the power-shift rig behind its measured slip, for `--rig power_shift.a` and `--rig power_shift.b`.

Equation        the clutch: as in `shaft_clutch`
                speed of the input shaft, with which the cylinders turn: w_in = (i_a s_b - i_b s_a)/(i_a - i_b)
                                                                                    from s = w_in - i w_out, docs/power_shift.md
Assumptions     both gear ratios are those of the parameters, and both slips were measured
Not modelled    motor, driveline and hand-over, which `clutch-hil identify` identifies; the other clutch
"""

import re
from dataclasses import replace

from clutch_hil.discrepancy.models.shaft_clutch import CYLINDER_SPEED, ShaftClutch
from clutch_hil.identify.two_clutches.clutch_columns import COLUMNS, name_column, select_clutch_columns
from clutch_hil.recordings.not_measured import read_not_measured
from plant_sim.rigs import power_shift
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.files.run import Run

_SLIP = "slip_speed_rad_s"


class PowerShiftClutch(ShaftClutch):
    """A clutch of the power-shift rig, with the names of columns, parameters and effects of the wet-clutch rig.

    parameters: of the whole rig; nominal ones if None. Raises InputError for equal gear ratios.
    """

    whole = power_shift.NAME
    clutch: str
    make_bench = None  # type: ignore[assignment]  # not `Experimenting`: no bench plays an experiment with one of two clutches

    def __init__(self, parameters: ParameterSet | None = None) -> None:
        rig = parameters or power_shift.load_nominal()
        super().__init__(power_shift.select_clutch_parameters(rig, self.clutch))
        self._ratios = a, b = [rig[f"driveline.ratio_{clutch}"].value for clutch in CLUTCHES]
        if a == b:
            raise InputError(f"driveline.ratio_a and driveline.ratio_b are both {a:g}; two gears must differ")

    @staticmethod
    def list_nominal_parameters() -> ParameterSet:
        """Return the parameters of the whole rig with every effect off."""
        return power_shift.load_nominal()

    def take_run(self, run: Run) -> Run:
        """See `PartOfRig`: the columns of this clutch, the speed of its cylinder, and the faults of the controllers."""
        for name in (*self.inputs, *(output.column for output in self.outputs)):
            if (own := name_column(name, self.clutch)) not in run.columns:
                raise InputError(f"lacks the column {own}, which the model {self.name} needs")
        columns = select_clutch_columns(run.columns, self.clutch)
        slips = [run.columns.get(name_column(_SLIP, clutch)) for clutch in CLUTCHES]
        (a, b), (of_a, of_b) = slips, self._ratios
        if a is not None and b is not None:
            columns[CYLINDER_SPEED] = (of_a * b - of_b * a) / (of_a - of_b)
        faults = {name: values for name, values in run.columns.items() if name.rpartition("_")[2] == "fault"}
        computed = select_clutch_columns(read_not_measured(run), self.clutch)
        names = {name_column(name, self.clutch): name for name in COLUMNS}
        for column, formula in computed.items():
            if isinstance(formula, str):
                computed[column] = re.sub(r"\w+", lambda word: names.get(word[0], word[0]), formula)
        return replace(
            run,
            columns={**faults, **columns},
            metadata={**run.metadata, "import": {"not_measured": computed}},
            units=select_clutch_columns(run.units, self.clutch),
            meanings={},
        )

    def name_in_whole(self, name: str) -> str:
        """See `PartOfRig`."""
        return name if power_shift.is_motor(name) else f"{self.clutch}.{name}"


class ClutchA(PowerShiftClutch):
    """Clutch a, of the 1st gear."""

    name = "power_shift.a"
    clutch = "a"


class ClutchB(PowerShiftClutch):
    """Clutch b, of the 2nd gear."""

    name = "power_shift.b"
    clutch = "b"
