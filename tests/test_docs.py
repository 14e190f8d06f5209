"""The documentation's Python runs as printed, and its links lead somewhere."""

import re
from pathlib import Path

import pytest

from protocols.telemetry import keys

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]


def test_the_code_of_the_friction_page_runs() -> None:
    page = (ROOT / "docs" / "friction.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) == 4
    for block in blocks:
        exec(compile(block, "docs/friction.md", "exec"), names)
    assert names["trace"].force.max() > 0.0  # type: ignore[attr-defined]
    assert names["motion"].friction.min() >= 0.0  # type: ignore[attr-defined]


def test_the_telemetry_page_has_the_keys() -> None:
    table = [line for line in str(keys.__doc__).splitlines() if line.startswith("|")]
    assert len(table) == len(keys.LEAVES) + 2
    assert "\n".join(table) in (ROOT / "docs" / "telemetry.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


@pytest.mark.parametrize(
    "folder", ["protocols", "plant_sim", "rt_controller", "clutch_hil", "benchmarks", "tests", "deploy", "docs"]
)
def test_sources_name_pages_that_a_clone_has(folder: str) -> None:
    pages = {page.name for page in PAGES} | {"notes.md"}  # of a battery, by whoever plays it
    kinds = {".py", ".toml", ".md", ".dbc", ".sh"}
    missing = {
        f"{path.relative_to(ROOT)}: {name}"
        for path in (ROOT / folder).rglob("*.*")
        if path.suffix in kinds
        for name in re.findall(r"[\w./-]*\b\w+\.md\b", path.read_text(encoding="utf-8"))
        if Path(name).name not in pages or Path(name).parent.name == "design"
    }
    assert not missing
