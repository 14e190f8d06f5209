"""Bars and sparklines: numbers as characters, for terminals."""

from math import isfinite

import numpy as np
from rich.text import Text

from clutch_hil.bench.pictures import palette

_HEIGHTS = "▁▂▃▄▅▆▇"  # without the full block, so that lines below each other stay separate


def draw_bar(value: float | None, full: float, width: int, style: str) -> Text:
    """Draw |value|/full as a bar of `width` characters; an empty bar for None and NaN."""
    share = min(abs(value) / full, 1.0) if value is not None and isfinite(value) else 0.0
    whole, half = divmod(round(share * width * 2), 2)
    return Text.assemble(("━" * whole + "╸" * half, style), ("─" * (width - whole - half), palette.DIM), no_wrap=True)


def draw_sparkline(values: np.ndarray, low: float, high: float) -> str:
    """Draw `values`, shape (points,), scaled from `low` to `high`, one character each; a blank for NaN."""
    scale = (len(_HEIGHTS) - 1) / max(high - low, 1e-12)
    levels = np.clip(np.round((np.nan_to_num(values) - low) * scale), 0, len(_HEIGHTS) - 1).astype(int)
    return "".join(_HEIGHTS[level] if known else " " for level, known in zip(levels, np.isfinite(values), strict=True))
