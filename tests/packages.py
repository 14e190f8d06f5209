"""Packages of users, laid out as pip would install them."""

import tomllib
from pathlib import Path


def lay_out(folder: Path, site: Path) -> None:
    """Put the modules and entry points of the package in `folder`, by its pyproject.toml, into the folder `site`."""
    document = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
    project = document["project"]
    metadata = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Name: {project['name']}\nVersion: {project['version']}\n")
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {place}" for name, place in points.items())]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n")
    for module in document["tool"]["setuptools"]["py-modules"]:
        (site / f"{module}.py").symlink_to(folder / f"{module}.py")
