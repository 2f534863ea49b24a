# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The documentation site: its pages exist and its links lead to pages; `make docs` builds it and checks the rest."""

from __future__ import annotations

import re
from importlib.util import module_from_spec, spec_from_file_location
from types import SimpleNamespace

import pytest

from posfet.reference_documents import PAGES, main
from posfet.replay_command import TO_FILE
from support.paths import DOCS, ROOT

SPEC = spec_from_file_location("docs_site", ROOT / "tools/docs/site.py")
assert SPEC
assert SPEC.loader
SITE = module_from_spec(SPEC)
SPEC.loader.exec_module(SITE)
CONFIGURATION = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
NAV = re.findall(r"^ +- [^:]+: (\S+\.md)$", CONFIGURATION, re.MULTILINE)


def made() -> set[str]:
    """Return every page of the site."""
    return {path.name for path in DOCS.glob("*.md")} | set(SITE.PAGES.values()) | {page for page, _ in SITE.reference()}


def test_the_navigation_names_each_page_once_and_none_that_does_not_exist() -> None:
    assert len(NAV) == len(set(NAV)) > 30
    assert set(NAV) <= made()
    assert set(SITE.PAGES.values()) <= {*NAV, "index.md"}


def test_pages_without_a_place_are_listed_as_how_tos() -> None:
    config = SimpleNamespace(nav=[{"Home": "index.md"}, {"How to": [{"Browser": "browser.md"}]}])
    [_, part] = SITE.on_config(config).nav
    assert "recording.md" in part["How to"]
    assert part["How to"].count("browser.md") == 0


@pytest.mark.parametrize("source", [*SITE.PAGES, *(f"docs/{path.name}" for path in sorted(DOCS.glob("*.md")))])
def test_links_lead_to_pages_and_files_of_the_site(source: str) -> None:
    page = SITE.PAGES.get(source, source.removeprefix("docs/"))
    text, files = SITE.for_site(source, page, (ROOT / source).read_text(encoding="utf-8"))
    assert all((ROOT / file).is_file() for file in files)
    inside = made() | {f"source/{file}" for file in files}
    outside_code = re.sub(r"^ *```.*?^ *```", "", text, flags=re.MULTILINE | re.DOTALL)
    for name in re.findall(r'(?:\]\(| src="| srcset=")(?![a-z]+:|#)([^)"#\s]+)', outside_code):
        assert name in inside or (DOCS / name).is_file(), f"{source}: {name}"


def test_links_are_rewritten() -> None:
    text, files = SITE.for_site("README.md", "index.md", "[a](docs/faq.md#x) [b](Makefile) [c](src) [d](https://x.y)")
    assert (text, files) == ("[a](faq.md#x) [b](source/Makefile) c [d](https://x.y)", {"Makefile"})
    text, _ = SITE.for_site(
        "README.md", "index.md", '<source srcset="docs/figures/a.svg"><img src="docs/figures/b.svg">'
    )
    assert text == '<source srcset="figures/a.svg"><img src="figures/b.svg">'
    text, _ = SITE.for_site("docs/faq.md", "faq.md", "[a](../README.md#topics) `[b](../src)`")
    assert text.startswith("[a](index.md#topics)")


def test_the_python_reference_has_every_public_module() -> None:
    pages = dict(SITE.reference())
    assert "::: posfet_model.device.film" in pages["api/posfet_model.device.md"]
    assert "api/posfet_sim.scene.md" in pages["api.md"]
    assert not [page for page in pages if "._" in page or "figures" in page]


@pytest.fixture(autouse=True)
def in_the_repository(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run where make runs; colcon runs the tests in the folder of the package."""
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("name", sorted(PAGES))
def test_the_generated_reference_is_up_to_date(name: str) -> None:
    assert (DOCS / name).read_text(encoding="utf-8") == PAGES[name](), "run: make reference"


def test_the_reference_names_the_arguments_of_a_replay_beside_its_options() -> None:
    [replay] = re.findall(r"^## posfet replay\n(.*?)(?=^## )", PAGES["commands.md"](), re.MULTILINE | re.DOTALL)
    assert replay.rstrip().endswith(f"With --out: {', '.join(argument.name for argument in TO_FILE)}.")


def test_the_reference_names_arguments_that_all_actions_share_once() -> None:
    [can] = re.findall(r"^## posfet can\n(.*?)(?=^## )", PAGES["commands.md"](), re.MULTILINE | re.DOTALL)
    assert can.count("`--data-bitrate ") == 1
    assert can.index("Every `posfet can ...` has:") < can.index("`--data-bitrate ") < can.index("### posfet can list")
    assert can.count("`-i, --interface ") == 7


def test_the_command_writes_the_reference(tmp_path: object, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.count("written") == len(PAGES)


def test_every_service_says_where_it_is_offered() -> None:
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src").glob("*/*/ros/*.py"))
    names = set(re.findall(r'(?:node|self)\.create_service\(\w+, "([^"]+)"', sources))
    assert len(names) == 5
    assert all(f"`{name}`" in PAGES["services.md"]() for name in names)
