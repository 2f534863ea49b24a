# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a release needs: versions in step, changelogs, dependencies that rosdep resolves, links that lead somewhere."""

from __future__ import annotations

import ast
import re
import runpy
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

import posfet_model
from support.paths import DATA, ROOT, SOURCES

PACKAGES = sorted(path.parent for path in SOURCES.glob("*/package.xml"))
VERSION = posfet_model.__version__
SHARED = ("support", "reference")
"""Folders beside the tests whose modules they import."""
each_package = pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)


def manifest(package: Path) -> ElementTree.Element:
    return ElementTree.parse(package / "package.xml").getroot()


def date(package: Path) -> str:
    """Return the date of the newest version in the changelog of a package."""
    return re.findall(r"^\S+ \((\d{4}-\d\d-\d\d)\)$", (package / "CHANGELOG.rst").read_text("utf-8"), re.MULTILINE)[0]


@each_package
def test_versions_are_in_step(package: Path) -> None:
    assert manifest(package).findtext("version") == VERSION
    setup = package / "setup.py"
    if setup.exists():
        assert re.findall(r'version="(.*?)"', setup.read_text(encoding="utf-8")) == [VERSION]
    sections = re.findall(
        r"^(\S+) \(\d{4}-\d\d-\d\d\)\n-+$", (package / "CHANGELOG.rst").read_text("utf-8"), re.MULTILINE
    )
    assert sections[0] == VERSION


def test_the_release_notes_and_the_citation_are_of_this_version() -> None:
    heading = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[0]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    dates = {date(package) for package in PACKAGES}
    assert dates == {str(citation["date-released"])}
    assert heading in {f"Unreleased: {VERSION}", f"{VERSION} - {dates.pop()}"}
    project = (ROOT / "python/pyproject.toml").read_text(encoding="utf-8")
    assert re.findall(r'^version = "(.*)"$', project, re.MULTILINE) == [VERSION]
    assert f"posfet-{VERSION}-cp3" in (ROOT / "docs/python.md").read_text(encoding="utf-8")
    assert citation["version"] == VERSION


def test_the_notes_of_a_tag_are_the_newest_sections_of_the_changelogs() -> None:
    command = ["bash", str(ROOT / "tools/release.sh"), "--notes"]
    title, *notes = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n\n")
    assert title == f"posfet {VERSION}"
    assert sorted(notes[::2]) == [package.name for package in PACKAGES]
    for name, text in zip(notes[::2], notes[1::2], strict=True):
        section = (SOURCES / name / "CHANGELOG.rst").read_text(encoding="utf-8").split("\n\n")[1]
        assert text.strip() == section.partition("---\n")[2].strip()


@each_package
def test_every_dependency_is_resolvable(package: Path) -> None:
    known = yaml.safe_load((DATA / "release/rosdep_keys.yaml").read_text(encoding="utf-8"))
    keys = {element.text for element in manifest(package) if element.tag.endswith("depend")}
    assert keys - known.keys() - {other.name for other in PACKAGES} == set()


@each_package
def test_a_manifest_names_who_and_where(package: Path) -> None:
    root = manifest(package)
    assert {url.get("type") for url in root.findall("url")} == {"website", "repository", "bugtracker"}
    assert root.find("author") is not None
    assert root.findtext("license") == "Apache-2.0"


def test_the_address_of_the_project_stands_in_one_place() -> None:
    """To be set before a release: the constants of tools/address.py, which writes the manifests."""
    address = runpy.run_path(str(ROOT / "tools/address.py"))
    assert address["stale"]() == {}, "run python3 tools/address.py"
    placeholder = ".invalid" in address["WEBSITE"]
    assert ("repository-code" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")) != placeholder
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "grep", "-l", r"posfet\.invalid"], capture_output=True, text=True, check=False
    )
    if listed.returncode == 0:  # a clone, in which all files are known
        owners = {"tools/address.py", "tools/release.sh"}
        others = {path for path in listed.stdout.split() if Path(path).name not in {"package.xml", "setup.py"}}
        assert others <= owners | {"test/layout/test_release.py"}


@each_package
def test_links_of_a_package_lead_to_what_its_release_holds(package: Path) -> None:
    links = [path for path in package.rglob("*") if path.is_symlink()]
    assert {"LICENSE"} <= {link.name for link in links}
    for link in links:
        assert link.exists(), f"{link}: leads nowhere"
        assert link.resolve().is_relative_to(ROOT)
    assert list((package / "test").rglob("*")), "no tests"
    assert (package / "pytest.ini").is_file(), "pytest would take the settings of the repository"


def imported(path: Path) -> set[str]:
    """Return the modules that a file may import, and the objects that it takes from them, by their full names."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{each.name}" for each in node.names)}
    return found


@each_package
def test_a_package_has_what_its_tests_import_from_beside_them(package: Path) -> None:
    """`colcon test` and a release run them in the folder of the package."""
    folder = package / "test"
    todo = [path for subject in folder.iterdir() if subject.name not in SHARED for path in subject.rglob("*.py")]
    read, missing = set(), set()
    while todo:
        path = todo.pop()
        for name in imported(path) - read:
            read.add(name)
            if name.partition(".")[0] in SHARED:
                module = folder.joinpath(*name.split(".")).with_suffix(".py")
                if module.is_file():
                    todo.append(module)
                elif not (folder / name.partition(".")[0]).is_dir():
                    missing.add(f"{path.relative_to(package)}: {name}")
    assert missing == set()
