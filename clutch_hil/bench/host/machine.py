"""Machine: properties of kernel, hardware and set-up that a bench needs, and the commands that change them."""

import ctypes
import os
import platform
import shutil
from pathlib import Path
from typing import NamedTuple

from clutch_hil.bench.host.exposure import describe_exposure, list_listeners
from clutch_hil.bench.host.unit_state import list_units, read_states

NETWORK = "network"  # name of the fact on who can reach the bench
_CPU = Path("/sys/devices/system/cpu")
_CAN_TYPE = "280"  # ARPHRD_CAN (linux/if_arp.h)
_UNSYNCHRONISED = 0x40  # STA_UNSYNC of timex.status (linux/timex.h)
_TIMEX_BYTES, _TIMEX_STATUS = 208, 40  # size of struct timex, and offset of `status` in it, on 64-bit machines
_BOOT = "add {} to GRUB_CMDLINE_LINUX in /etc/default/grub, sudo update-grub, and restart"


class Fact(NamedTuple):
    """A property and its `state`. good: whether it suits a bench, None if it has no influence. remedy: how to change it."""

    name: str
    state: str
    good: bool | None
    remedy: str = ""


def list_facts() -> list[Fact]:
    """Return the facts on this machine: those that affect jitter, most important first; clock, buses, network, units."""
    return [
        _check_kernel(), _check_isolation(), _check_ticks(), _check_governor(), _check_siblings(),
        _check_throttling(), _check_huge_pages(), _check_clock_source(), _check_hypervisor(), _check_cyclictest(),
        _check_time_of_day(), _check_can_interfaces(), _check_network(), _check_units(),
    ]  # fmt: skip


def _read(path: Path | str) -> str | None:
    try:
        return Path(path).read_text(encoding="utf-8").strip()
    except OSError:
        return None


def _check_kernel() -> Fact:
    preemptible = "PREEMPT_RT" in platform.version() or _read("/sys/kernel/realtime") == "1"
    state = f"Linux {platform.release()}, {'PREEMPT_RT' if preemptible else 'not PREEMPT_RT'}"
    return Fact("kernel", state, preemptible, "sudo apt-get install linux-image-rt-amd64, and boot it")


def _check_isolation() -> Fact:
    cpus = _read(_CPU / "isolated")
    last = (os.cpu_count() or 1) - 1
    wanted = f"isolcpus={last} rcu_nocbs={last} irqaffinity=0"
    return Fact("CPUs isolated for the loop", cpus or "none", bool(cpus), _BOOT.format(wanted))


def _check_ticks() -> Fact:
    cpus = _read(_CPU / "nohz_full")
    off = cpus in (None, "", "(null)")
    last = (os.cpu_count() or 1) - 1
    return Fact(
        "CPUs without a scheduler tick", "none" if off else str(cpus), not off, _BOOT.format(f"nohz_full={last}")
    )


def _check_governor() -> Fact:
    governors = {_read(path) for path in _CPU.glob("cpu[0-9]*/cpufreq/scaling_governor")} - {None}
    if not governors:
        return Fact("clock frequency", "set by the host or the hardware", None)
    state = ", ".join(sorted(str(one) for one in governors))
    return Fact("clock frequency", state, governors == {"performance"}, "sudo cpupower frequency-set -g performance")


def _check_siblings() -> Fact:
    shared = {_read(path) for path in _CPU.glob("cpu[0-9]*/topology/thread_siblings_list")} - {None}
    pairs = sorted(str(one) for one in shared if "," in str(one) or "-" in str(one))
    if not pairs:
        return Fact("CPUs that share a core", "none", True)
    return Fact("CPUs that share a core", "; ".join(pairs), False, f"echo off | sudo tee {_CPU}/smt/control")


def _check_throttling() -> Fact:
    runtime = _read("/proc/sys/kernel/sched_rt_runtime_us")
    state = "off" if runtime == "-1" else f"real-time work may take {int(runtime or 0) // 1000} ms of every second"
    return Fact("real-time throttling", state, None)


def _check_huge_pages() -> Fact:
    modes = _read("/sys/kernel/mm/transparent_hugepage/enabled") or "not available"
    chosen = modes.partition("[")[2].partition("]")[0] or modes
    remedy = "echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled"
    return Fact("transparent huge pages", chosen, chosen != "always", remedy)


def _check_clock_source() -> Fact:
    source = _read("/sys/devices/system/clocksource/clocksource0/current_clocksource") or "unknown"
    good = source in ("tsc", "arch_sys_counter", "kvm-clock")
    return Fact(
        "clock source", source, good, "choose one that is read without the kernel, by the boot option clocksource=tsc"
    )


def _check_hypervisor() -> Fact:
    virtual = " hypervisor" in (_read("/proc/cpuinfo") or "")
    state = "virtual: pauses by the host appear as late cycles" if virtual else "bare metal"
    return Fact("machine", state, not virtual, "use a physical machine if the worst latencies matter")


def _check_time_of_day() -> Fact:
    """Check whether the clock that stamps logged changes is synchronised (NTP, PTP)."""
    timex = ctypes.create_string_buffer(_TIMEX_BYTES)  # no modes set: the call only reads
    if ctypes.CDLL(None, use_errno=True).adjtimex(timex) < 0:
        return Fact("time of day", "cannot be read", None)
    status = int.from_bytes(timex.raw[_TIMEX_STATUS : _TIMEX_STATUS + 4], "little")
    kept = not status & _UNSYNCHRONISED
    state = (
        "synchronised to a time server"
        if kept
        else "not synchronised to a time server: logs of several machines do not match"
    )
    return Fact("time of day", state, kept, "sudo timedatectl set-ntp true")


def _check_can_interfaces() -> Fact:
    there = sorted(p.parent.name for p in Path("/sys/class/net").glob("*/type") if _read(p) == _CAN_TYPE)
    down = [name for name in there if not int(_read(f"/sys/class/net/{name}/flags") or "0", 16) & 1]  # IFF_UP
    state = (
        ", ".join(f"{name} (down)" if name in down else name for name in there)
        or "none; local:NAME can be used instead"
    )
    remedy = "sudo modprobe vcan && sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up"
    if down:
        remedy = f"sudo ip link set {down[0]} up"
    return Fact("CAN interfaces", state, bool(there) and not down, remedy)


def _check_network() -> Fact:
    state, good = describe_exposure(list_listeners())
    return Fact(NETWORK, state, good, "end that process, or start it with a file of `clutch-hil secure`")


def _check_units() -> Fact:
    """Check the systemd units that run a bench, and their states."""
    there = list_units()
    if not there:
        return Fact("units of systemd", "none installed: the bench is started by hand", None)
    states = read_states(there)
    failed = [state.name for state in states if state.active == "failed"]
    return Fact("units of systemd", ", ".join(map(str, states)), not failed, f"journalctl -b -u {' -u '.join(failed)}")


def _check_cyclictest() -> Fact:
    path = shutil.which("cyclictest")
    return Fact("cyclictest", path or "not installed", bool(path), "sudo apt-get install rt-tests")
