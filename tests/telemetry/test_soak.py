"""Ten minutes at 1 kHz, played beside all other tests: nothing is lost."""

import json

import pytest

from tests.telemetry.soak_process import SECONDS, Soak

RATE = 1000  # Hz
SHARE = 0.9  # of the slots in which a cycle ran at least: the other tests have the machine too
MEDIAN_AGE = 0.1  # s from a cycle to its row at a listener; 0.015 typical


def test_ten_minutes_of_telemetry_lose_nothing(soak: Soak, capsys: pytest.CaptureFixture[str]) -> None:
    came = soak.result()
    with capsys.disabled():
        print(f"\n{json.dumps(came, indent=2)}")
    for node in came.values():
        assert node["rows"] == node["last"] + 1
        assert node["in_order"]
        assert node["lost"] == 0
        assert node["rows"] > SHARE * SECONDS * RATE
        assert node["age_p50"] < MEDIAN_AGE
