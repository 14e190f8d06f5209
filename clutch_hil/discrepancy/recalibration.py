"""Recalibration: the baseline fitted beyond its stated uncertainty, and how much of a disagreement this explains."""

from dataclasses import dataclass

from clutch_hil.discrepancy.decision import CLOSED_EXCESS, DISAGREEMENT
from protocols.files.units import space_unit

# of what the effects leave: if a re-calibration leaves at most this share, the effects only imitate a calibration
LEFT_BESIDE = 0.1
_MOST_TOLD = 6  # parameters listed in a sentence
_UNIT = 0.05  # uncertainty of a parameter that declares none: the same as in identify (free_parameters.py)


@dataclass(frozen=True)
class Moved:
    """A baseline parameter that moved from `nominal` to `value`, in `unit`. uncertainty: as stated, 0 if none is stated."""

    name: str
    nominal: float
    value: float
    unit: str
    uncertainty: float

    @property
    def sigmas(self) -> float:
        """Return the change in stated uncertainties; a parameter without one counts _UNIT as its uncertainty."""
        return abs(self.value - self.nominal) / (self.uncertainty or _UNIT * abs(self.nominal) or 1.0)

    def __str__(self) -> str:
        unit = space_unit(self.unit)
        how = f"{self.sigmas:.1f} stated uncertainties" if self.uncertainty > 0.0 else "no uncertainty stated"
        return f"{self.name} {self.nominal:.4g} -> {self.value:.4g}{unit} ({how})"


@dataclass(frozen=True)
class Recalibration:
    """The baseline fitted beyond its stated uncertainty.

    moved: parameters that moved, the largest change first, those without a stated uncertainty last. before, after, effects:
    power above the floor, as a share of the number of residuals, of the baseline within its uncertainty, of the re-calibrated
    baseline, and of the effects that explain most. margin: the effects explain as well as the re-calibration if they leave at
    most this much more. command: command that identifies the rig, None for a model without one. likely: whether several
    effects, or alternatives, would be named and the calibration lies within its stated distribution.
    """

    moved: tuple[Moved, ...]
    before: float
    after: float
    effects: float
    margin: float
    command: str | None
    likely: bool = False

    @property
    def explains(self) -> bool:
        """Return whether the re-calibration explains the disagreement better than the effects do.

        It must leave no disagreement, or almost nothing of what the effects leave, and the effects must leave clearly more. A
        likely calibration that explains everything is preferred to several effects or alternatives without this comparison.
        """
        if self.likely and self.after <= CLOSED_EXCESS:
            return True
        enough = max(DISAGREEMENT, LEFT_BESIDE * self.effects)
        return self.after <= enough and self.effects > self.after + self.margin

    @property
    def equals(self) -> bool:
        """Return whether the re-calibration explains as much as the effects, so that the runs cannot distinguish them.

        It must leave no disagreement, or no more than the effects do.
        """
        return not self.explains and self.after <= max(DISAGREEMENT, self.effects)

    @property
    def is_complete(self) -> bool:
        """Return whether the re-calibration leaves no disagreement."""
        return self.after <= DISAGREEMENT

    @property
    def closed(self) -> float:
        """Return the share of the disagreement that is explained; 1 where the baseline leaves none and is only improbable."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 1.0

    @property
    def advice(self) -> str:
        """Return what the user should do."""
        if self.command:
            return f"run: {self.command}, then discrepancy with its file as --calibration"
        return "state these values, or larger uncertainties, in the model's parameters"

    def __str__(self) -> str:
        """Return which parameters moved, and how far."""
        changes = "; ".join(map(str, self.moved[:_MOST_TOLD]))
        more = len(self.moved) - _MOST_TOLD
        return f"{changes}; and {more} more" if more > 0 else changes

    def as_json(self) -> dict[str, object]:
        """Return the entry `recalibration` of `report.json`."""
        moved = [vars(one) | {"sigmas": one.sigmas} for one in self.moved]
        return {"moved": moved, "command": self.command, "explains": self.explains, "before": self.before,
                "after": self.after, "effects": self.effects}  # fmt: skip
