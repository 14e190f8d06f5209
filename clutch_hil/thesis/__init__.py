"""Reproductions: figures and tables of the thesis, and claims of this project, each checked by running it.

A reproduction is a function that fills a `Sheet`, marked with `@register_reproduction(name, title, claim)` in one of MODULES.
Names are `figure-2.12` and `table-6.1`, or `fig 2.12`; a bare `2.12` means the figure, else the table.
"""

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module

from clutch_hil.thesis.check_sheet import Sheet
from clutch_hil.thesis.contradictions import CONTRADICTED
from protocols.errors import InputError

MODULES = (
    "asperities.generic",
    "asperities.rayleigh_step",
    "asperities.rayleigh_pair",
    "asperities.rayleigh_stribeck",
    "asperities.generic_rayleigh",
    "asperities.asperity_stiffness",
    "tribometer.tribometer_frf",
    "tribometer.tribometer_normal",
    "tribometer.tribometer_dry",
    "tribometer.tribometer_stribeck",
    "tribometer.tribometer_lift",
    "tribometer.lubrication_regimes",
    "control_models.stribeck",
    "control_models.stribeck_data",
    "control_models.gms",
    "control_models.gms_elements",
    "control_models.friction_compensation",
    "clutch.clutch_temperature",
    "clutch.clutch_piston",
    "clutch.clutch_stationary",
    "clutch.clutch_lag",
    "clutch.clutch_response",
    "clutch.clutch_dynamics",
    "appendices.appendix_c",
    "appendices.appendix_d",
    "appendices.appendix_d_asymmetric",
    "appendices.appendix_e",
    "appendices.appendix_e_lag",
    "control_models.cross_level",
    "control_models.microtribometer",
    "clutch.table_6_6",
    "clutch.adaptation",
)

_KINDS = {"fig": "figure", "fig.": "figure", "figure": "figure", "table": "table"}  # by accepted spelling


@dataclass(frozen=True)
class Entry:
    """One reproduction: `claim` is what the thesis states, `run` fills a sheet with the picture and the checks."""

    name: str
    title: str
    claim: str
    run: Callable[[Sheet], None]

    @property
    def contradiction(self) -> str:
        """Why the claim is known not to hold; empty if it is not."""
        known = CONTRADICTED.get(self.name)
        return known.reason if known else ""

    def list_news(self, failed: Sequence[str]) -> list[str]:
        """List the `failed` statements that are not known to fail, and the known ones that no longer do."""
        known = CONTRADICTED.get(self.name)
        return known.list_news(failed) if known else list(failed)


_ENTRIES: dict[str, Entry] = {}


def register_reproduction(
    name: str, title: str, claim: str
) -> Callable[[Callable[[Sheet], None]], Callable[[Sheet], None]]:
    """Register the decorated function as the reproduction `name`."""

    def register(run: Callable[[Sheet], None]) -> Callable[[Sheet], None]:
        before = _ENTRIES[name].run if name in _ENTRIES else run
        if (before.__module__, before.__qualname__) != (run.__module__, run.__qualname__):
            raise ValueError(f"reproduction {name} is defined twice")
        _ENTRIES[name] = Entry(name, title, claim, run)
        return run

    return register


def load_entries() -> dict[str, Entry]:
    """Load all reproductions, by name: those of the thesis in its order, then those of this project."""
    for module in MODULES:
        import_module(f"clutch_hil.thesis.{module}")
    return dict(sorted(_ENTRIES.items(), key=lambda item: _make_sort_key(item[0])))


def find_entry(name: str) -> Entry:
    """Find the reproduction called `name`, or the figure or table of that number. Raises InputError."""
    known = load_entries()
    kind, space, number = name.partition(" ")
    spelled = f"{_KINDS[kind.lower()]}-{number}" if space and kind.lower() in _KINDS else name
    for candidate in (spelled, f"figure-{name}", f"table-{name}"):
        for key in known:
            if key.lower() == candidate.lower():
                return known[key]
    close = difflib.get_close_matches(name.lower(), known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(close)}?" if close else "`clutch-hil reproduce --list` lists all"
    raise InputError(f"reproduction {name!r} does not exist; {hint}")


def _make_sort_key(name: str) -> tuple[int, str, int, str]:
    kind, _, number = name.partition("-")
    chapter, _, rest = number.partition(".")
    if kind not in ("figure", "table") or not rest.isdigit():
        return (1, "", 0, name)
    return (0, chapter, int(rest), kind)
