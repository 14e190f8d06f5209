"""Runs a command in a guest whose kernel has CAN, for hosts whose kernel has none.

The guest is Debian's User Mode Linux: a Linux kernel which runs as an ordinary process and has a `vcan0` which is up.
CMD sees the host's files; what it writes stays in the guest's memory, but for folders given with --writable.
`python deploy/guest/can_guest.py -- CMD ARG...` exits with CMD's code, or with one of the guest's own:
3 no guest can run here, 124 the time is over, 125 the guest died.
"""

import argparse
import ctypes
import mmap
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, NoReturn

HERE = Path(__file__).resolve().parent
PACKAGES = ("user-mode-linux", "can-utils", "busybox-static")
TOOL_FILES = ("usr/bin/linux.uml", "usr/bin/candump", "bin/busybox")
PASSED_NAMES = ("CI", "HOME", "LANG", "TERM", "TZ", "VIRTUAL_ENV")
PASSED_PREFIXES = ("CLUTCH_HIL_", "LC_", "NUMBA_", "PYTEST_", "PYTHON")
EXIT_UNAVAILABLE, EXIT_TIMEOUT, EXIT_DIED = 3, 124, 125
SYSTEMD = Path("/lib/systemd/systemd")
VIRTUAL_TIME_KERNEL = "linux.virtual-time"  # in the cache folder: what build_kernel.sh makes
PR_SET_CHILD_SUBREAPER = 36
POLL_S = 0.01


class NoGuestError(Exception):
    """This machine cannot run a guest."""


class GuestDiedError(Exception):
    """The guest ended without the command's exit code."""


class GuestTimeoutError(Exception):
    """The command was still running when its time was over."""


def find_cache_dir() -> Path:
    """Folder which keeps what was downloaded."""
    return Path(os.environ.get("CLUTCH_HIL_CACHE") or Path.home() / ".cache/clutch-hil/uml")


def find_tools() -> Path | None:
    """Root of the file tree which has kernel, modules, can-utils and busybox: the system's or the cache's."""
    for root in (Path("/"), find_cache_dir() / "debian"):
        modules = root / "usr/lib/uml/modules"
        if all((root / name).is_file() for name in TOOL_FILES) and modules.is_dir():
            return root
    return None


def fetch_tools() -> Path:
    """Downloads the packages with apt, as any user, and unpacks them below the cache folder in one step."""
    for program in ("apt-get", "dpkg-deb"):
        if not shutil.which(program):
            raise NoGuestError(f"{program} is missing, so {', '.join(PACKAGES)} cannot be downloaded")
    target = find_cache_dir() / "debian"
    try:
        find_cache_dir().mkdir(parents=True, exist_ok=True)
        work = tempfile.TemporaryDirectory(prefix="download-", dir=find_cache_dir())
    except OSError as error:
        raise NoGuestError(f"the cache folder {find_cache_dir()} cannot be written: {error.strerror}") from error
    with work as name:
        download_packages(Path(name))
        tree = Path(name) / "tree"
        for package in Path(name).glob("*.deb"):
            if subprocess.run(["dpkg-deb", "-x", package, tree], capture_output=True).returncode != 0:
                raise NoGuestError(f"dpkg-deb cannot unpack {package.name} below {find_cache_dir()}")
        with suppress(OSError):  # another process has put its tree there
            tree.rename(target)
    return target


def download_packages(folder: Path) -> None:
    """Puts the packages into `folder`; reads package lists of its own when the system's do not serve."""
    download = ["download", *PACKAGES]
    if run_apt_get(folder, *download) == 0:
        return
    (folder / "lists/partial").mkdir(parents=True)
    (folder / "archives/partial").mkdir(parents=True)
    own = (
        f"-oDir::State::lists={folder}/lists",
        f"-oDir::Cache={folder}",
        "-oAPT::Sandbox::User=root",
        "-oAPT::Update::Error-Mode=any",
    )
    if run_apt_get(folder, *own, "update") != 0 or run_apt_get(folder, *own, *download) != 0:
        reason = (folder / "apt.log").read_text().strip().splitlines()[-1]
        raise NoGuestError(f"apt-get cannot download {', '.join(PACKAGES)}: {reason}")


def run_apt_get(folder: Path, *arguments: str) -> int:
    """Exit code of apt-get, run in `folder`, its words kept in apt.log there."""
    with (folder / "apt.log").open("ab") as log:
        return subprocess.run(["apt-get", "-q", *arguments], cwd=folder, stdout=log, stderr=log).returncode


def prepare_tools() -> Path:
    """Root of the tools' file tree, downloaded if need be."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        raise NoGuestError(f"User Mode Linux needs Linux on x86-64, this is {sys.platform} {platform.machine()}")
    return find_tools() or fetch_tools()


def compile_xstate() -> Path | None:
    """Compiled xstate.c (see there) on processors which need it."""
    if " amx_tile" not in Path("/proc/cpuinfo").read_text():
        return None
    source = HERE / "xstate.c"
    library = find_cache_dir() / f"xstate-{source.stat().st_mtime_ns}.so"
    if not library.exists():
        compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
        if not compiler:
            raise NoGuestError("this processor has AMX, for which deploy/guest/xstate.c needs a C compiler (cc)")
        library.parent.mkdir(parents=True, exist_ok=True)
        part = library.with_suffix(f".{os.getpid()}")
        words = [compiler, "-O2", "-shared", "-fPIC", "-o", str(part), str(source), "-ldl"]
        if subprocess.run(words, capture_output=True).returncode != 0:
            raise NoGuestError(f"{compiler} cannot compile {source}, which a processor with AMX needs")
        part.rename(library)
    return library


def find_memory_dir(size: int) -> Path:
    """Folder for the guest's memory file: has `size` bytes free and lets files be mapped executable."""
    folders = (Path("/dev/shm"), Path(tempfile.gettempdir()), Path("/var/tmp"))
    for folder in folders:
        with suppress(OSError), tempfile.TemporaryFile(dir=folder) as file:
            file.truncate(mmap.PAGESIZE)
            mmap.mmap(file.fileno(), mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_EXEC).close()
            if shutil.disk_usage(folder).free > size:
                return folder
    names = ", ".join(map(str, folders))
    raise NoGuestError(f"none of {names} has {size >> 20} MiB free for the guest's memory and allows programs")


def parse_size(text: str) -> int:
    """Bytes of a size like 2G or 512M."""
    units = {"M": 1 << 20, "G": 1 << 30}
    if not text[:-1].isdigit() or text[-1:] not in units:
        raise argparse.ArgumentTypeError(f"size {text!r} is not like 2G or 512M")
    return int(text[:-1]) * units[text[-1]]


def parse_folder(text: str) -> Path:
    """Absolute path of a folder which exists."""
    path = Path(text).resolve()
    if not path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is not a folder")
    return path


def make_guest_environment(run: Path) -> dict[str, str]:
    """Environment of the command inside the guest."""
    passed = {k: v for k, v in os.environ.items() if k in PASSED_NAMES or k.startswith(PASSED_PREFIXES)}
    path = os.environ.get("PATH", os.defpath)
    return passed | {
        "PATH": f"{path}:/usr/sbin:/usr/bin:/sbin:/bin:{run}/tools/usr/bin:{run}/bin",
        "PYTHONUNBUFFERED": "1",  # output goes to a file which the host reads along
        "CLUTCH_HIL_GUEST": "1",
    }


def list_sources(folder: Path) -> Iterator[Path]:
    """The files of which kernels are made, in packages directly below `folder`."""
    for package in folder.iterdir():
        if (package / "__init__.py").is_file():
            yield from (path for path in package.rglob("*") if path.suffix in (".py", ".dbc"))


def write_run(
    run: Path,
    tools: Path,
    command: list[str],
    writable: Iterable[Path],
    boot: bool,
    image: Path | None,
    sources: Path | None,
) -> None:
    """Fills the folder of a run with what init.sh reads."""
    if boot:
        (run / "boot").touch()
        shutil.copy(HERE / "boot.sh", run)
    if image:
        (run / "image").symlink_to(image)
    (run / "tools").symlink_to(tools)
    (run / "bin").mkdir()
    (run / "bin/ip").symlink_to(tools / "bin/busybox")  # last on the PATH, for hosts without iproute2
    shutil.copy(HERE / "init.sh", run)
    places = [shlex.quote(str(path)) for path in writable]
    mounts = [f"$busybox mount -t hostfs -o {place} none $root{place}\n" for place in places]
    if sources:
        times = {str(path): path.stat().st_mtime_ns for path in list_sources(sources)}
        lines = f"import os\nfor path, time in {times!r}.items():\n    os.utime(path, ns=(time, time))\n"
        (run / "times.py").write_text(lines)
        mounts.append(f"$busybox chroot $root {shlex.quote(sys.executable)} $run/times.py\n")
    (run / "mounts.sh").write_text("".join(mounts))
    variables = [f"{name}={value}" for name, value in make_guest_environment(run).items()]
    words = shlex.join(["env", "-i", *variables, *command])
    (run / "command.sh").write_text(f"cd {shlex.quote(os.getcwd())} && exec {words}\n")
    for name in ("stdout", "stderr", "init.log"):
        (run / name).touch()


def choose_kernel(tools: Path, virtual_time: bool) -> list[str]:
    """The kernel's program, and its parameters for the clock: Debian's, or the one whose clock stands while it computes."""
    if not virtual_time:
        return [str(tools / "usr/bin/linux.uml")]
    own = find_cache_dir() / VIRTUAL_TIME_KERNEL
    if not own.is_file():
        raise NoGuestError(f"{own} is missing: {HERE / 'build_kernel.sh'} builds it")
    return [str(own), "time-travel=inf-cpu"]


@contextmanager
def guest_process(run: Path, memory: int, program: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """The guest's kernel; none of its processes outlives the block, nor this process should that be killed."""
    kernel = [
        *program,
        *("rootfstype=hostfs", "rootflags=/", "ro", f"mem={memory >> 20}M", "hostname=can-guest"),
        *(f"uml_dir={run}", "con=null", "con0=null,fd:1", "ssl=null"),
        *(f"init={run}/tools/bin/busybox", "--", "sh", f"{run}/init.sh", str(run)),
    ]
    environment = os.environ | {"TMPDIR": str(find_memory_dir(memory))}
    if library := compile_xstate():
        environment["LD_PRELOAD"] = str(library)
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1)  # what the kernel leaves behind becomes our child
    with (run / "kernel.log").open("wb") as log:
        process = subprocess.Popen(
            kernel, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
        )
    end_guest = f"read _; kill -KILL -{process.pid}"
    guard = subprocess.Popen(
        ["sh", "-c", end_guest], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    )
    assert guard.stdin
    try:
        yield process
    finally:
        guard.stdin.close()  # as happens when this process is killed
        with suppress(ChildProcessError):  # no child is left
            while True:
                os.waitpid(-1, 0)


def forward(source: BinaryIO, target: BinaryIO) -> None:
    """Copies what is new in `source`."""
    if text := source.read():
        target.write(text)
        target.flush()


def run_in_guest(
    command: list[str],
    *,
    timeout: float,
    memory: int,
    writable: Iterable[Path] = (),
    boot: bool = False,
    image: Path | None = None,
    sources: Path | None = None,
    virtual_time: bool = False,
) -> int:
    """Exit code of `command` inside a guest, its output forwarded while it runs; `boot` and so on: see the options."""
    tools = prepare_tools()
    program = choose_kernel(tools, virtual_time)
    if boot and not SYSTEMD.is_file():
        raise NoGuestError(f"{SYSTEMD} is missing, which the guest boots: apt-get install systemd")
    deadline = time.monotonic() + timeout
    with tempfile.TemporaryDirectory(prefix="can-guest-") as name:
        run = Path(name)
        write_run(run, tools, command, writable, boot, image, sources)
        exit_code = run / "exit-code"
        with (
            guest_process(run, memory, program) as guest,
            (run / "stdout").open("rb") as out,
            (run / "stderr").open("rb") as err,
        ):
            ended = False
            while not ended:
                ended = exit_code.exists() or guest.poll() is not None
                forward(out, sys.stdout.buffer)
                forward(err, sys.stderr.buffer)
                if time.monotonic() > deadline and not ended:
                    raise GuestTimeoutError(
                        f"{shlex.join(command)} was still running in the CAN guest after {timeout:g} s"
                    )
                time.sleep(POLL_S)
        if exit_code.exists():
            return int(exit_code.read_text())
        raise GuestDiedError(f"the CAN guest died before {shlex.join(command)} ended: {read_last_words(run)}")


def read_last_words(run: Path) -> str:
    """Why the guest died: its kernel's panic, else the end of its logs."""
    lines = [
        line for name in ("kernel.log", "init.log") for line in (run / name).read_text(errors="replace").splitlines()
    ]
    panics = [line for line in lines if "Kernel panic" in line]
    return panics[0] if panics else "\n  ".join(["", *lines[-20:]])


def check(timeout: float, memory: int) -> int:
    """Boots a guest and says in one line whether that works; 0 if it does."""
    try:
        tools = prepare_tools()
        began = time.monotonic()
        booted = run_in_guest(["test", "-e", "/sys/class/net/vcan0"], timeout=timeout, memory=memory) == 0
    except (NoGuestError, GuestDiedError, GuestTimeoutError) as error:
        print(f"no CAN guest can run here: {str(error).splitlines()[0]}")
        return 1
    version = next((tools / "usr/lib/uml/modules").iterdir()).name
    word = "runs" if booted else "runs without vcan0"
    print(f"a CAN guest {word} here: {tools / 'usr/bin/linux.uml'} {version}, {time.monotonic() - began:.1f} s to boot")
    return 0 if booted else 1


def stop(number: int, _frame: object) -> NoReturn:
    """Ends this process in order, so that the guest ends with it."""
    raise SystemExit(128 + number)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="Runs a command in a guest whose kernel has CAN, with vcan0 up.")
    parser.add_argument("--check", action="store_true", help="only say whether a guest can run here (0 yes, 1 no)")
    parser.add_argument("--timeout", type=float, default=600, metavar="S", help="seconds before the guest is ended")
    parser.add_argument("--memory", type=parse_size, default="2G", metavar="SIZE", help="the guest's memory, like 2G")
    parser.add_argument(
        "--writable",
        type=parse_folder,
        action="append",
        default=[],
        metavar="DIR",
        help="host folder where files written are kept (repeatable); others are lost with the guest",
    )
    parser.add_argument(
        "--boot",
        action="store_true",
        help="boot the host's systemd in the guest, without the host's units and without vcan0; CMD is a unit of its own",
    )
    parser.add_argument(
        "--image",
        type=parse_folder,
        metavar="DIR",
        help="with --boot: files that are laid over the guest's root before",
    )
    parser.add_argument(
        "--sources",
        type=parse_folder,
        metavar="DIR",
        help="give sources below DIR their times to the nanosecond, by which kernels are found; a guest"
        " sees whole seconds of the host's files",
    )
    parser.add_argument(
        "--virtual-time",
        action="store_true",
        help="the guest's clock stands while it computes, so that no rate is too high; needs the kernel of build_kernel.sh",
    )
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="-- CMD ARG...", help="what runs in the guest")
    arguments = parser.parse_args()
    if arguments.virtual_time and arguments.boot:
        parser.error("--virtual-time does not go with --boot: its kernel was never booted with systemd")
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    if arguments.check:
        return check(arguments.timeout, arguments.memory)
    command = arguments.command[1:] if arguments.command[:1] == ["--"] else arguments.command
    if not command:
        parser.error("the command is missing: can_guest.py -- CMD ARG...")
    try:
        return run_in_guest(
            command, timeout=arguments.timeout, memory=arguments.memory, writable=arguments.writable, boot=arguments.boot,
            image=arguments.image, sources=arguments.sources, virtual_time=arguments.virtual_time,
        )  # fmt: skip
    except NoGuestError as error:
        print(f"no CAN guest can run here: {error}", file=sys.stderr)
        return EXIT_UNAVAILABLE
    except GuestTimeoutError as error:
        print(error, file=sys.stderr)
        return EXIT_TIMEOUT
    except GuestDiedError as error:
        print(error, file=sys.stderr)
        return EXIT_DIED


if __name__ == "__main__":
    sys.exit(main())
