"""Summary of a service at its end as text: timing, frames, notes. The bench and the service's own terminal show it."""

from typing import Any

from protocols.can.reception import REJECTED
from protocols.errors import format_count

_UNWANTED_COUNTS = ("minor_faults", "major_faults", "collections", "threads_begun")
_NOTED_LATE_SHARE = 1e-3  # share of late and skipped cycles above which a note reports disturbed timing


def format_service(name: str, service: dict[str, Any]) -> list[str]:
    """Format the summary `service` of the service `name` as lines."""
    lines = []
    port = service["port"]
    gated = service["frames"].values()
    lost, rejected = (sum(sum(frame[key] for key in keys) for frame in gated) for keys in (("lost",), REJECTED))
    clock = service["timing"]
    if clock:
        wake, work = clock["wake"], clock["work"]
        share = 100.0 * clock["late"] / max(clock["cycles"], 1)
        lines.append(
            f"{name + ':':<12} {clock['cycles']} cycles, late {clock['late']} ({share:.3f} %), skipped {clock['skipped']};"
            f" wake-up p50 {wake['p50_us']:.0f} p99 {wake['p99_us']:.0f} max {wake['max_us']:.0f} us;"
            f" work p50 {work['p50_us']:.0f} p99 {work['p99_us']:.0f} max {work['max_us']:.0f} us"
        )
    lines.append(
        f"{'' if clock else name + ':':<12} frames sent {port['sent']}, received {port['received']}, lost {lost},"
        f" rejected {rejected}, refused by full queues {port['refused']}, not sent while the bus was down {port['down']}"
    )
    lines += [f"{'':<12} note: {text}" for text in _describe_rejections(service)]
    if clock and clock["late"] + clock["skipped"] > _NOTED_LATE_SHARE * clock["slots"]:
        share_text = f"{100 * _NOTED_LATE_SHARE:g} %"
        lines.append(f"{'':<12} note: more than {share_text} late or skipped: the timing of this run was disturbed")
    # at least one second of samples: a separate plant that continued after its profile
    if clock and service.get("samples", 0) > clock["slots"] + service["rate_hz"]:
        later = service["samples"] - clock["slots"]
        lines.append(
            f"{'':<12} note: cycles are those of the profile; {format_count(later, 'sample')} followed after it"
        )
    if any((footprint := service.get("footprint") or {}).get(what) for what in _UNWANTED_COUNTS):
        counts = ", ".join(
            f"{footprint[what]} {what.replace('_', ' ')}" for what in _UNWANTED_COUNTS if footprint[what]
        )
        lines.append(f"{'':<12} note: counted during the loop: {counts}")
    lines += [f"{'':<12} note: {text}" for text in service["not_available"]]
    if service["telemetry"] not in ("ended", "off"):
        lines.append(f"{'':<12} note: telemetry {service['telemetry']}")
    return lines


def _describe_rejections(service: dict[str, Any]) -> list[str]:
    """Return which frames were not used, and why; the run continued without them."""
    notes = []
    rejected = {
        name: ", ".join(f"{counts[what]} {what}" for what in REJECTED if counts[what])
        for name, counts in service["frames"].items()
    }
    if any(rejected.values()):
        notes.append("frames rejected: " + "; ".join(f"{name} {what}" for name, what in rejected.items() if what))
    if first := service.get("first_rejected"):
        notes.append(f"the first of them: {first}")
    if strays := service.get("stray_frames"):
        counted = (
            f"{name} {counts['received'] + sum(counts[what] for what in REJECTED)}" for name, counts in strays.items()
        )
        notes.append(f"another sender used identifiers of this service: {', '.join(counted)}")
    if ignored := service["port"].get("ignored"):
        notes.append(f"{format_count(ignored, 'frame')} ignored: remote, error, CAN FD, or with an extended identifier")
    return notes
