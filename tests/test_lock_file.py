"""`requirements.lock` has what `pyproject.toml` asks for, at a version that it allows and by hash, for each Python."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
HASHES = re.compile(r" +--hash=sha256:[0-9a-f]{64}")


def list_requirements() -> list[Requirement]:
    """What set-up needs: the build backend, the dependencies and those of the tests."""
    table = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project = table["project"]
    lines = table["build-system"]["requires"] + project["dependencies"] + project["optional-dependencies"]["test"]
    return [Requirement(line) for line in lines]


def list_locked() -> list[tuple[Requirement, list[str]]]:
    """The entries of the lock file, each with its lines of hashes."""
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    lines = [line.removesuffix(" \\") for line in text.splitlines() if not line.lstrip().startswith("#")]
    entries: list[tuple[Requirement, list[str]]] = []
    for line in lines:
        if line.startswith(" "):
            entries[-1][1].append(line)
        else:
            entries.append((Requirement(line), []))
    return entries


def find_version(name: str, python: str) -> str | None:
    """The version of a package that the lock file gives a Python on Linux, on x86-64 and arm64."""
    environments = [
        {
            "python_version": python,
            "python_full_version": f"{python}.0",
            "sys_platform": "linux",
            "platform_machine": machine,
        }
        for machine in ("x86_64", "aarch64")
    ]
    versions = [
        str(entry.specifier).removeprefix("==")
        for entry, _ in list_locked()
        if canonicalize_name(entry.name) == canonicalize_name(name)
        and (entry.marker is None or all(entry.marker.evaluate(environment) for environment in environments))
    ]
    assert len(versions) <= 1
    return versions[0] if versions else None


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.parametrize("requirement", list_requirements(), ids=lambda requirement: requirement.name)
def test_every_requirement_is_locked(requirement: Requirement, python: str) -> None:
    version = find_version(requirement.name, python)
    assert version is not None, f"{requirement} is not in requirements.lock: make lock"
    assert version in requirement.specifier, f"{requirement} does not allow the locked {version}: make lock"


def test_what_requirements_need_is_locked_too() -> None:
    """Set-up installs with --no-deps. If pip resolved by itself, a new release of a package that another asks for with an extra
    would end it (coverage[toml] of pytest-cov)."""
    here = {canonicalize_name(e.name) for e, _ in list_locked() if e.marker is None or e.marker.evaluate()}
    waiting, seen = [(r.name, frozenset(r.extras)) for r in list_requirements()], set()
    while waiting:
        name, extras = one = waiting.pop()
        if one in seen:
            continue
        seen.add(one)
        assert canonicalize_name(name) in here, f"{name} is needed and not in requirements.lock: make lock"
        try:
            needed = [Requirement(line) for line in requires(name) or ()]
        except PackageNotFoundError:  # the build backend, where it came from elsewhere
            continue
        chosen = [{"extra": extra} for extra in extras or {""}]
        waiting += [
            (r.name, frozenset(r.extras)) for r in needed if r.marker is None or any(map(r.marker.evaluate, chosen))
        ]
    assert len(seen) > len(list_requirements())


def test_every_entry_is_one_version_with_hashes() -> None:
    for entry, hashes in list_locked():
        assert re.fullmatch(r"==[^,*]+", str(entry.specifier)), entry
        assert hashes, entry
        assert all(HASHES.fullmatch(line) for line in hashes), entry


def test_the_lock_file_names_no_package_index() -> None:
    assert "://" not in (ROOT / "requirements.lock").read_text(encoding="utf-8")
