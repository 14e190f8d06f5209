"""`clutch-hil identify --friction lift-up`: the lift-up force of an oil film from butterflies, the gap over a position."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from clutch_hil.command import report
from protocols.errors import InputError

FILES = ("lift_up.toml", "lift_up.png")


def run_lift_up(
    runs: list[Path], law: str, columns: Mapping[str, str], gap: str, known: Mapping[str, float], low_pass: float, rig: str,
    out: Path, overwrite: bool, json_output: bool,
) -> None:  # fmt: skip
    """Identify F_N(v, a) and write its files. known: parameters of the contact, in SI, by name."""
    from clutch_hil.bench.progress import ActivityLine, format_table
    from clutch_hil.bench.recording import writable_folder
    from clutch_hil.identify.friction import butterflies
    from clutch_hil.identify.friction.lift_up import identify_lift_up, simulate_lift
    from clutch_hil.identify.friction.slide_record import Columns
    from protocols.files.output_file import check_new_files, whole_files

    allowed = (*butterflies.KNOWN, *butterflies.BESIDE)
    if odd := [name for name in known if name not in allowed]:
        raise InputError(f"--hold {odd[0]} is not a parameter of a lift-up; allowed are {', '.join(allowed)}")
    contact = butterflies.make_contact(known)
    check_new_files(out, FILES, overwrite, runs)
    with writable_folder(out), ActivityLine("reading", json_output) as line:
        records, digests = butterflies.read_butterflies(runs, Columns(**columns), gap, known, low_pass)
        lift_up = identify_lift_up(
            records,
            contact,
            kind=butterflies.LAWS[law],
            progress=lambda done, total: line.update(f"search {done} of {total}"),
        )
        line.update("drawing")
        result = butterflies.LiftUpResult(lift_up, digests, rig, butterflies.format_now())
        figure = butterflies.draw_lift_up(result, records, [simulate_lift(lift_up, record) for record in records])
        with whole_files(out) as parts:
            figure.savefig(parts / FILES[1], dpi=110, format="png")
            result.write(parts / FILES[0])
    rows: list[Sequence[str]] = [("parameter", "value", "95 % interval", "unit")]
    for name, value in lift_up.values.items():
        low, high = lift_up.intervals[name]
        rows.append((name, f"{value:.5g}", f"{low:.5g} to {high:.5g}", butterflies.UNITS[name]))
    wrote = [str(out / name) for name in FILES]
    text = "\n".join([
        format_table(rows), "", *(f"warning: {line}" for line in lift_up.warnings), f"read:    {', '.join(map(str, runs))}",
        f"wrote:   {', '.join(wrote)}",
    ])  # fmt: skip
    report({**result.as_json(), "read": [*map(str, runs)], "wrote": wrote}, text, result.verdict, True, json_output)
