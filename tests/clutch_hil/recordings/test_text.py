"""Text files in every form are read alike, and what was decided is told."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.channel import choose_channel
from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.text_files import (
    FORMS,
    ISO,
    MAP,
    NAMES,
    PREAMBLE,
    ROWS,
    SPEED,
    TIME,
    TORQUE,
    assert_right,
    convert_run,
    find_refusal,
    make_table,
    read,
    write_with_comma,
)  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_recording(tmp_path: Path, form: str) -> None:
    content, file = FORMS[form]
    run = read(tmp_path, content, file)
    assert_right(run, spacing=np.spacing(1.8e9) if "epoch" in form else 1e-9)
    assert "between cells" in convert_run(run)


# --- what is told -----------------------------------------------------------------------------------------------------


def test_what_was_found_is_told_a_sentence_each(tmp_path: Path) -> None:
    content = (
        PREAMBLE + make_table(";", header="time;torque;speed\ns;kNm;rpm", write=write_with_comma) + "Mean;0,1;2\nEnd\n"
    )
    run = read(tmp_path, content.encode("cp1252"), columns=MAP.replace(', unit = "s"', ""))
    assert run.metadata["import"]["done"] == [
        "text in utf-8, ';' between cells, ',' as decimal mark",
        "names in line 6",
        "units in line 7",
        "above the names: Recorder: bench 7; Date: 2025-03-02 10:11; Sample rate [Hz]: 100; Operator, Smith",
        "left out lines 68 to 69 at the end, statistics: 'Mean;0,1;2'",
        "torque: the file says kNm, the map Nm; the file's unit is used",
        "speed: the file says rpm, the map rad/s; the file's unit is used",
    ]
    assert run.metadata["Sample rate [Hz]"] == 100.0
    np.testing.assert_allclose(run["torque_nm"], 1e3 * TORQUE)
    np.testing.assert_allclose(run["speed_rad_s"], SPEED * np.pi / 30.0)


def test_a_code_page_is_told(tmp_path: Path) -> None:
    run = read(tmp_path, FORMS["cp1252"][0])
    assert "was read as cp1252; set encoding" in convert_run(run)


@pytest.mark.parametrize(
    ("names", "encoding", "shown"),
    [
        ("時間,トルク,速度", "cp932", "'ŽžŠÔ' is '時間' in cp932"),
        ("时间,扭矩,速度", "gbk", "'时间' in gbk"),
        ("시간,토크,속도", "euc_kr", "'시간' in euc_kr"),
        ("время,момент,скорость", "cp1251", "'âðåìÿ' is 'время' in cp1251"),
        ("Öltemp,moment,speed", "cp437", "'Öltemp' in cp437"),
        ("Öltemp,moment,speed", "mac_roman", "'Öltemp' in mac_roman"),
        ("größe,öltemp,weg [µm]", "cp1252", ""),
    ],
)
def test_another_code_page_is_told_by_what_the_first_word_is_in_it(
    tmp_path: Path, names: str, encoding: str, shown: str
) -> None:
    content = make_table(header=names).encode(encoding)
    columns = MAP
    for own, name in zip(NAMES, names.split(","), strict=True):
        columns = columns.replace(f'"{own}"', f'"{name}"')
    by_number = '[columns]\ntime_s = { number = 1, unit = "s" }\ntorque_nm = { number = 2, unit = "Nm" }\n'
    done = convert_run(read(tmp_path, content, columns=by_number))
    assert (shown in done) if shown else ("' is '" not in done)
    if shown:
        assert shown in find_refusal(tmp_path, content, columns=columns)
        assert_right(read(tmp_path, content, f'encoding = "{encoding}"', columns))


@pytest.mark.parametrize("encoding", ["cp437", "gbk", "cp932", "euc_kr"])
def test_a_micro_sign_of_another_code_page_does_not_lose_its_factor(tmp_path: Path, encoding: str) -> None:
    micro = "µ" if encoding == "cp437" else "μ"
    content = make_table(header=f"time,torque [{micro}Nm],speed").encode(encoding)
    assert "which is unknown, and in Nm by the map" in find_refusal(tmp_path, content)
    run = read(tmp_path, content, f'encoding = "{encoding}"')
    np.testing.assert_allclose(run["torque_nm"], 1e-6 * TORQUE)


def test_damaged_bytes_do_not_make_a_code_page_of_utf_8(tmp_path: Path) -> None:
    content = make_table(header="time,torque,speed,temp [°C],remark", end=",20,ok").encode().replace(b"ok", b"\xff", 1)
    columns = MAP + 'oil_temperature_degc = { from = "temp [°C]" }\n'
    run = read(tmp_path, content, columns=columns)
    assert "some bytes are not UTF-8 and were replaced" in convert_run(run)
    np.testing.assert_allclose(run["oil_temperature_degc"], 20.0)


@pytest.mark.parametrize(
    ("times", "start"),
    [
        (ISO, "2025-03-02T10:11:12"),
        ([cell + "+01:00" for cell in ISO], "2025-03-02T09:11:12+00:00"),
        ([f"{cell[11:]} pm" for cell in ISO], "22:11:12"),
        ([f"{1740910272.5 + t:.4f}" for t in TIME], "2025-03-02T10:11:12.500000+00:00"),
    ],
)
def test_the_time_of_day_of_the_first_row_is_kept(tmp_path: Path, times: list[str], start: str) -> None:
    assert read(tmp_path, make_table(times=times)).metadata["import"]["start"] == start


def test_the_list_of_channels_has_names_units_kinds_and_rates(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    path.write_text(
        make_table(header="t [s],Torque [Nm],x[2],Torque [Nm],ok,phase,", end=",1.5,false,shift,"), encoding="utf-8"
    )
    channels = open_recording(path).channels
    assert [(c.number, c.name, c.path, c.unit, c.kind) for c in channels] == [
        (1, "t", "t [s]", "s", "number"),
        (2, "Torque [Nm]", "Torque [Nm] (column 2)", "Nm", "number"),
        (3, "x[2]", "x[2]", "", "number"),
        (4, "Torque [Nm]", "Torque [Nm] (column 4)", "Nm", "number"),
        (5, "ok", "ok", "", "status"),
        (6, "phase", "phase", "", "text"),
    ]
    assert {c.rows for c in channels} == {ROWS}
    assert channels[1].rate_hz == pytest.approx(100.0)
    assert (channels[1].start_s, channels[1].end_s) == pytest.approx((0.0, TIME[-1]))
    assert choose_channel(path, channels, "t").number == choose_channel(path, channels, "t [s]").number == 1
    with pytest.raises(InputError, match="has 2 columns 'Torque"):
        choose_channel(path, channels, "Torque [Nm]")


def test_a_flag_is_held_and_not_interpolated(tmp_path: Path) -> None:
    ends = ["off" if row < 20 else "ON" for row in range(ROWS)]
    lines = [line + f",{end}" for line, end in zip(make_table().splitlines()[1:], ends, strict=True)]
    content = "\n".join(["time,torque,speed,lock", *lines])
    run = read(tmp_path, content, "resample_hz = 150.0", MAP + 'lock_1 = { from = "lock", unit = "1" }\n')
    assert set(run["lock_1"]) == {0.0, 1.0}
    assert "held the last value of lock_1" in convert_run(run)
