"""Summary of a service as text."""

from typing import Any

import pytest

from clutch_hil.bench.service_text import format_service

SHARES = {"p50_us": 1.0, "p99_us": 2.0, "max_us": 3.0}


def describe(samples: int = 1000, late: int = 0, skipped: int = 0) -> list[str]:
    """Lines of a plant of 1000 Hz that had 1000 slots in its profile."""
    clock: dict[str, Any] = {
        "cycles": 1000 - skipped, "slots": 1000, "late": late, "skipped": skipped, "wake": SHARES, "work": SHARES,
    }  # fmt: skip
    port = dict.fromkeys(("sent", "received", "refused", "down"), 0)
    service = {"port": port, "frames": {}, "timing": clock, "not_available": [], "telemetry": "ended", "rate_hz": 1000}
    return format_service("plant", service | {"samples": samples})


@pytest.mark.parametrize(
    ("late", "skipped", "disturbed"), [(1, 0, False), (0, 1, False), (2, 0, True), (1, 34, True), (0, 2, True)]
)
def test_late_and_skipped_cycles_disturb_the_timing_of_a_run(late: int, skipped: int, disturbed: bool) -> None:
    lines = describe(late=late, skipped=skipped)
    assert any("more than 0.1 % late or skipped" in line for line in lines) is disturbed


def test_samples_after_the_profile_of_a_plant_of_its_own_are_told() -> None:
    assert not any("followed after it" in line for line in describe(samples=2000))
    assert "note: cycles are those of the profile; 1001 samples followed after it" in describe(samples=2001)[-1]
