# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The Python package without ROS: what its wheel holds, and that it works in an environment that has nothing else."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import posfet_model
from posfet.cli import COMMANDS, LEFT_OUT, NEED_ROS
from support.paths import ROOT, SOURCES

if not all(importlib.util.find_spec(name) for name in ("pip", "pybind11", "setuptools")):
    pytest.skip("needs pip, pybind11 and setuptools", allow_module_level=True)
packaging_requirements = pytest.importorskip("packaging.requirements")

ROS = {
    *("rclpy", "rcl_interfaces", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "lifecycle_msgs", "launch"),
    *("posfet_msgs", "rosgraph_msgs", "sensor_msgs", "std_msgs", "tf2_msgs", "tf2_ros", "visualization_msgs"),
    *("ament_index_python", "launch_ros"),
}
OWN = {"posfet", "posfet_core", "posfet_driver", "posfet_model", "posfet_sim"}
MODULES = ("scan_path", "protocol")
"""Compiled modules of posfet_core."""
SUFFIX = sysconfig.get_config_var("EXT_SUFFIX")
GUARDED = LEFT_OUT | {"posfet.middleware_check"}
"""Modules with ROS that are imported only where that is installed, or by a command that says that it needs ROS."""


def built(kind: str, source: Path, folder: Path) -> Path:
    """Return the wheel or the sdist that setuptools builds from a folder, as pip and build do."""
    program = f"import sys; from setuptools import build_meta; build_meta.build_{kind}(sys.argv[1])"
    command = [sys.executable, "-c", program, str(folder)]
    done = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return next(folder.glob("*.whl" if kind == "wheel" else "*.tar.gz"))


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of python/, so that nothing is left in the repository."""
    folder = tmp_path_factory.mktemp("repository")
    shutil.copytree(ROOT / "python", folder / "python", ignore=shutil.ignore_patterns("build", "*.egg-info"))
    (folder / "src").symlink_to(SOURCES)
    return folder / "python"


@pytest.fixture(scope="module")
def distribution(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution, unpacked."""
    folder = tmp_path_factory.mktemp("distribution")
    with tarfile.open(built("sdist", source, folder)) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    [unpacked] = (folder / "unpacked").iterdir()
    return unpacked


def give_modules(project: Path) -> None:
    """Put the compiled modules that are in use where setuptools builds them, and takes them for up to date."""
    plat, python = sysconfig.get_platform(), sys.implementation.cache_tag
    folder = project / "build" / f"lib.{plat}-{python}" / "posfet_core"
    folder.mkdir(parents=True)
    for name in MODULES:
        shutil.copyfile(str(importlib.import_module(f"posfet_core.{name}").__file__), folder / f"{name}{SUFFIX}")


@pytest.fixture(scope="module")
def wheel(distribution: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the source distribution, with the compiled modules that are in use: they take minutes to compile."""
    give_modules(distribution)
    return built("wheel", distribution, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def modules(wheel: Path) -> dict[str, ast.Module]:
    """The syntax tree of each module of the wheel, by its name."""
    with zipfile.ZipFile(wheel) as archive:
        sources = {name: archive.read(name).decode() for name in archive.namelist() if name.endswith(".py")}
    return {
        name.removesuffix(".py").removesuffix("/__init__").replace("/", "."): ast.parse(text)
        for name, text in sources.items()
    }


def imported(tree: ast.Module) -> Iterator[str]:
    """Yield the names of all modules that a module imports; `from package import name` may name a module, too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def test_the_wheel_holds_all_that_runs_without_ros(wheel: Path, modules: dict[str, ast.Module]) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    for package in OWN - {"posfet"}:
        root = SOURCES / package
        files = {path.relative_to(root).as_posix() for path in (root / package).rglob("*") if path.is_file()}
        expected = {name for name in files if "__pycache__" not in name and "/ros/" not in name}
        assert expected - held == set()
    assert {path.name for path in (SOURCES / "posfet_msgs/msg").glob("*.msg")} == {
        name.rpartition("/")[2] for name in held if name.startswith("posfet_sim/recording/msg/")
    }
    assert "posfet/py.typed" in held
    assert {f"posfet_core/{name}{SUFFIX}" for name in MODULES} <= held
    assert not [name for name in held if "/test" in name or "web/" in name]
    assert {COMMANDS[name][0].partition(":")[0] for name in COMMANDS.keys() - NEED_ROS} <= modules.keys()
    assert modules.keys().isdisjoint(LEFT_OUT)


def contents(wheel: Path) -> dict[str, int]:
    """Return the checksum of each file of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        return {each.filename: each.CRC for each in archive.infolist()}


def test_the_repository_builds_the_same_wheel(source: Path, distribution: Path, wheel: Path, tmp_path: Path) -> None:
    give_modules(source)
    assert contents(built("wheel", source, tmp_path)) == contents(wheel)


def test_the_source_distribution_has_every_source_and_header_of_the_compiled_modules(distribution: Path) -> None:
    core = distribution / "src/posfet_core"
    held = {path.relative_to(core): path.read_text() for path in core.rglob("*.[ch]pp")}
    wanted = {path.relative_to(SOURCES / "posfet_core") for path in (SOURCES / "posfet_core").rglob("src/**/*.cpp")}
    assert wanted - held.keys() == set()
    for path, text in held.items():
        for name in re.findall(r'^#include "(.+)"$', text, re.MULTILINE):
            places = {Path(os.path.normpath(path.parent / name)), Path("include", name)}
            assert places & held.keys(), f"{path} includes {name}"


@pytest.mark.slow
def test_the_source_distribution_compiles(distribution: Path, tmp_path: Path) -> None:
    project = tmp_path / "project"
    shutil.copytree(distribution, project, ignore=shutil.ignore_patterns("build"))
    with zipfile.ZipFile(built("wheel", project, tmp_path)) as archive:
        archive.extractall(tmp_path / "wheel")
    program = "import posfet_core.scan_path, posfet_core.protocol as last; print(last.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "wheel")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(tmp_path / "wheel"))


def test_no_module_imports_ros(modules: dict[str, ast.Module]) -> None:
    found = {(name, used) for name, tree in modules.items() for used in imported(tree) if used.split(".")[0] in ROS}
    assert found == set()


def test_every_import_of_its_own_is_in_the_wheel(wheel: Path, modules: dict[str, ast.Module]) -> None:
    compiled = {name.removesuffix(SUFFIX).replace("/", ".") for name in contents(wheel) if name.endswith(SUFFIX)}
    found = {
        (name, used)
        for name, tree in modules.items()
        for used in imported(tree)
        if used.split(".")[0] in OWN and used not in modules and used not in GUARDED | compiled
    }
    assert found == set()


def test_the_version_is_that_of_the_packages(wheel: Path) -> None:
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    assert wheel.name.startswith(f"posfet-{posfet_model.__version__}-{python}-{python}-linux_")


def needed(wheel: Path) -> set[str]:
    """Return the names of the distributions that the wheel needs without its extras, and those that they need."""
    with zipfile.ZipFile(wheel) as archive:
        metadata = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        lines = archive.read(metadata).decode().splitlines()
    wanted = [line.removeprefix("Requires-Dist: ") for line in lines if line.startswith("Requires-Dist: ")]
    names: set[str] = set()
    while wanted:
        requirement = packaging_requirements.Requirement(wanted.pop())
        if requirement.marker and not requirement.marker.evaluate({"extra": ""}):
            continue
        if requirement.name.lower() not in names:
            names.add(requirement.name.lower())
            wanted += importlib.metadata.requires(requirement.name) or []
    return names


def run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command without the variables by which packages of this repository would be found."""
    kept = {name: value for name, value in os.environ.items() if name in {"HOME", "LANG", "PATH"}}
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, env=kept, check=False, timeout=120)


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of a fresh environment with the wheel and, as links, what it needs."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, symlinks=True, with_pip=False)
    packages = next(folder.glob("lib/python*/site-packages"))
    try:
        for name in needed(wheel):
            distribution = importlib.metadata.distribution(name)
            for top in {path.parts[0] for path in distribution.files or []} - {"..", "__pycache__"}:
                (packages / top).symlink_to(Path(str(distribution.locate_file(top))))
    except importlib.metadata.PackageNotFoundError as error:
        pytest.skip(f"{error.name} is installed without metadata")
    interpreter = folder / "bin/python"
    command = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(interpreter),
        "install",
        "--quiet",
        "--no-compile",
        "--no-deps",
        "--no-index",
    ]
    done = run([*command, "--disable-pip-version-check", str(wheel)], folder)
    assert done.returncode == 0, done.stderr
    return interpreter


FIRST_CONTACT = """
import importlib.util, posfet
assert importlib.util.find_spec("rclpy") is None
assert posfet.__file__.startswith({prefix!r}), posfet.__file__
for contacts in posfet.simulate("press_slide_lift", seed=1).contacts():
    if contacts.valid and len(contacts):
        print(contacts.sequence, *contacts)
        break
posfet.simulate("press").record("press.mcap", seconds=0.2)
print(len(posfet.replay("press.mcap").arrays()))
"""


def test_the_first_contact_in_a_fresh_environment(python: Path, tmp_path: Path) -> None:
    done = run([str(python), "-c", FIRST_CONTACT.format(prefix=str(python.parents[1]))], tmp_path)
    assert done.returncode == 0, done.stderr
    first, recorded = done.stdout.splitlines()
    assert first.split(" ", 1)[1].startswith("<Contact #1 new 0.0")
    assert recorded == "200"


@pytest.mark.parametrize(
    ("words", "code", "output"),
    [
        (["--version"], 0, f"posfet {posfet_model.__version__}"),
        (["view"], 1, "posfet view: needs ROS 2, and this is the Python package without it"),
        (["replay", "x.mcap"], 1, "posfet replay: needs ROS 2, and this is the Python package without it"),
        (["sim", "tap", "--for", "0.1", "--out", "tap.mcap"], 0, "tap.mcap: 100 scans"),
        (["design", "paper"], 0, ""),
        (["can", "--help"], 0, "usage: posfet can"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_commands_run_or_say_that_they_need_ros(
    python: Path, tmp_path: Path, words: list[str], code: int, output: str
) -> None:
    done = run([str(python.parent / "posfet"), *words], tmp_path)
    said = done.stderr if code else done.stdout
    assert done.returncode == code, done.stderr
    assert said.startswith(output)
    assert not code or len(said.splitlines()) == 1


def test_the_help_names_the_commands_that_need_ros(python: Path, tmp_path: Path) -> None:
    lines = run([str(python.parent / "posfet"), "--help"], tmp_path).stdout.splitlines()
    assert f"Here is no ROS 2, which {', '.join(sorted(NEED_ROS))} need." in lines
