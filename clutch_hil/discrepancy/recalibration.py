"""Recalibration: the baseline fitted beyond its stated uncertainty, and what it says of a disagreement."""

from dataclasses import dataclass

from clutch_hil.discrepancy.decision import CLOSED_EXCESS, DISAGREEMENT

# Of what the effects leave: a re-calibration that leaves no more says that they only stand for a calibration
LEFT_BESIDE = 0.1
_MOST_TOLD = 6  # parameters in a sentence
_UNIT = 0.05  # of a parameter that declares no uncertainty: as identify has it (free_parameters.py)


@dataclass(frozen=True)
class Moved:
    """A parameter of the baseline that moved from `nominal` to `value`, in `unit`. uncertainty: as stated, 0 without."""

    name: str
    nominal: float
    value: float
    unit: str
    uncertainty: float

    @property
    def sigmas(self) -> float:
        """How far, in stated uncertainties; _UNIT counts as one where none is stated."""
        return abs(self.value - self.nominal) / (self.uncertainty or _UNIT * abs(self.nominal) or 1.0)

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        how = f"{self.sigmas:.1f} stated uncertainties" if self.uncertainty > 0.0 else "no uncertainty stated"
        return f"{self.name} {self.nominal:.4g} -> {self.value:.4g}{unit} ({how})"


@dataclass(frozen=True)
class Recalibration:
    """The baseline fitted beyond its stated uncertainty.

    moved: parameters that moved, the farthest first, those without a stated uncertainty last. before, after, effects: power
    above the floor as a share of the number of residuals, of the baseline within its uncertainty, of this one, and of the
    effects that explain most. margin: by how much more the effects may leave than this and still count as explaining it as
    well. command: what identifies the rig, None for a model without one. likely: whether it is one as it was stated, beside
    several effects or alternatives.
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
        """Whether it explains what disagrees, or nearly all that the effects leave, and these do not explain it as well.

        Several effects, or alternatives, are not believed beside a likely calibration that explains all.
        """
        if self.likely and self.after <= CLOSED_EXCESS:
            return True
        enough = max(DISAGREEMENT, LEFT_BESIDE * self.effects)
        return self.after <= enough and self.effects > self.after + self.margin

    @property
    def is_complete(self) -> bool:
        """Whether it leaves no disagreement."""
        return self.after <= DISAGREEMENT

    @property
    def closed(self) -> float:
        """Share of the disagreement that it explains; 1 where the baseline leaves none, and is only unlikely."""
        return 1.0 - self.after / self.before if self.before > 0.0 else 1.0

    @property
    def advice(self) -> str:
        """What to do."""
        if self.command:
            return f"type: {self.command}, then discrepancy with its file as --calibration"
        return "state these values, or larger uncertainties, in the model's parameters"

    def __str__(self) -> str:
        """Which parameters moved how far."""
        changes = "; ".join(map(str, self.moved[:_MOST_TOLD]))
        more = len(self.moved) - _MOST_TOLD
        return f"{changes}; and {more} more" if more > 0 else changes

    def as_json(self) -> dict[str, object]:
        """The entry `recalibration` of `report.json`."""
        moved = [vars(one) | {"sigmas": one.sigmas} for one in self.moved]
        return {"moved": moved, "command": self.command, "explains": self.explains, "before": self.before,
                "after": self.after, "effects": self.effects}  # fmt: skip
