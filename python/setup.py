# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What of ../src is in the wheel and in the source distribution: everything that runs without ROS."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

OUTSIDE = "../"
SOURCES = next(folder for folder in (Path(OUTSIDE, "src"), Path("src")) if folder.is_dir())
"""Folder of the packages: in the repository, or in an unpacked source distribution."""
PACKAGES = ("posfet", "posfet_core", "posfet_driver", "posfet_model", "posfet_sim")
MESSAGES = "posfet_sim.recording.msg"
ONLY = {
    "posfet": {"__init__", "can", "cli", "doctor", "gym", "replay_command"},
    "posfet_model.ros": {"__init__", "contacts_cdr", "exit_codes", "model_settings", "on_demand", "start"},
}
"""Packages of which only these modules run without ROS."""
WITHOUT = {"posfet.terminal", "posfet.web", "posfet_driver.ros", "posfet_sim.ros"}
"""Packages that need ROS, or are used only with it."""


CORE = SOURCES / "posfet_core"
"""Folder of the compiled path."""


class WithoutRos(build_py):
    """Leaves out the modules that need ROS."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        found = super().find_package_modules(package, package_dir)
        return [entry for entry in found if package not in ONLY or entry[1] in ONLY[package]]


class WithPackages(sdist):
    """Takes the packages in, as src/ beside setup.py."""

    def make_release_tree(self, base_dir: str, files: Sequence[str]) -> None:
        super().make_release_tree(base_dir, [name for name in files if not name.startswith(OUTSIDE)])
        for name in (*files, *headers()):
            if name.startswith(OUTSIDE):
                target = Path(base_dir, name.removeprefix(OUTSIDE))
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(name, target)


def headers() -> list[str]:
    """Return the headers of the compiled path, which sdist does not take from an extension outside of its folder."""
    return sorted(str(path) for path in CORE.rglob("*.hpp"))


def compiled() -> list[Extension]:
    """Return the compiled path; its options are those of posfet_core/CMakeLists.txt, without debug information."""
    try:
        import pybind11  # noqa: PLC0415  # from PyPI or python3-pybind11

        found = [pybind11.get_include()]
    except ImportError:
        found = []  # pybind11-dev: where the compiler looks
    return [
        Extension(
            f"posfet_core.{name}",
            sources=sorted(str(path) for folder in folders for path in folder.glob("*.cpp")),
            depends=headers(),
            include_dirs=[str(CORE / "include"), *found],
            extra_compile_args=["-std=c++17", "-O2", "-g0", "-ffp-contract=off", "-fvisibility=hidden"],
            language="c++",
        )
        for name, folders in (
            ("scan_path", (CORE / "src", CORE / "src" / "estimation")),
            ("protocol", (CORE / "src" / "protocol",)),
        )
    ]


def packages() -> dict[str, str]:
    """Return the folder of each package."""
    folders = {MESSAGES: str(SOURCES / "posfet_msgs/msg")}
    for top in PACKAGES:
        for name in [top, *(f"{top}.{part}" for part in find_packages(str(SOURCES / top / top)))]:
            if name not in WITHOUT and not name.startswith(tuple(f"{each}." for each in WITHOUT)):
                folders[name] = str(SOURCES / top / name.replace(".", "/"))
    return folders


setup(
    cmdclass={"build_py": WithoutRos, "sdist": WithPackages},
    ext_modules=compiled(),
    packages=sorted(packages()),
    package_dir=packages(),
    package_data={
        "posfet": ["py.typed"],
        "posfet_core": ["py.typed", "*.pyi"],
        "posfet_driver": ["py.typed", "protocol/*.dbc", "protocol/*.yaml"],
        "posfet_model": ["py.typed", "design/designs/*.yaml", "sensor/sensors/*.yaml", "spice/netlists/*"],
        "posfet_sim": ["py.typed", "scene/scenes/*.yaml"],
        MESSAGES: ["*.msg"],
    },
    include_package_data=False,
    zip_safe=False,
)
