# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The linters of ROS, configured for what ruff formats and sorts; `make check` runs stricter ones."""

from __future__ import annotations

from pathlib import Path
from shutil import which

import pytest

CONFIGURATION = Path(__file__).resolve().with_name("flake8.ini")
NOT_CHECKED = ("D100", "D105", "D107", "D401")
"""Rules besides those that numpydoc leaves out: docstrings of setup.py and of special methods; the mood, which ruff
checks and here would count for properties, too."""

UNREACHABLE = "Failed to locate the main schema resource"
"""What xmllint says where it cannot read the schema of package.xml, which is a web address."""


@pytest.fixture
def folders(request: pytest.FixtureRequest) -> list[Path]:
    """Return the package that is tested alone, otherwise all sources."""
    root = request.config.rootpath
    return [root] if (root / "package.xml").is_file() else [root / name for name in ("src", "launch", "examples")]


@pytest.fixture
def sources(folders: list[Path]) -> list[Path]:
    """Return the same; skip a package of messages only."""
    if not any(path.name != "setup.py" for folder in folders for path in folder.glob("[!t]*/**/*.py")):
        pytest.skip("no source files")
    return folders


def test_flake8(sources: list[Path]) -> None:
    main = pytest.importorskip("ament_flake8.main", reason="needs ament_flake8").main_with_errors
    code, errors = main(argv=["--config", str(CONFIGURATION), *map(str, sources)])
    assert code == 0, "\n".join(errors)


def test_pep257(sources: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    main = pytest.importorskip("ament_pep257.main", reason="needs ament_pep257").main
    tests = [str(path) for folder in sources for path in folder.glob("**/test/conftest.py")]
    words = ["--convention", "numpy", "--add-ignore", *NOT_CHECKED, "--exclude", *tests, "--", *map(str, sources)]
    assert main(argv=words) == 0, capsys.readouterr().err


def test_copyright(sources: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    main = pytest.importorskip("ament_copyright.main", reason="needs ament_copyright").main
    assert main(argv=[*map(str, sources)]) == 0, capsys.readouterr().err


def test_xmllint(folders: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    main = pytest.importorskip("ament_xmllint.main", reason="needs ament_xmllint").main
    if which("xmllint") is None:
        pytest.skip("needs xmllint (apt install libxml2-utils)")
    code = main(argv=[*map(str, folders)])
    report = capsys.readouterr().err
    if UNREACHABLE in report:
        pytest.skip(f"{UNREACHABLE}: no network, and no catalog in XML_CATALOG_FILES that has it")
    assert code == 0, report
