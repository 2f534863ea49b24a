# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What MkDocs adds to docs/: documents of other folders, the Python reference, files that pages link to."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "src/posfet_msgs/README.md": "message-examples.md",
    "benchmarks/RESULTS.md": "performance.md",
}
"""Pages of the site, by the document of the repository that they are made from."""
STYLE = Path(__file__).with_name("style.css")
PACKAGES = ("posfet_core", "posfet_model", "posfet_driver", "posfet_sim", "posfet")
LEFT_OUT = {"figures"}
"""Subpackages that users of the library do not import."""
LINK = re.compile(r'(?:(?<=\]\()|(?<= src=")|(?<= srcset="))(?![a-z]+:|#)([^)"\s#]+)(#[^)"\s]*)?(?=[)"])')
"""Links of Markdown, and pictures in HTML, which have one for light and one for dark pages."""


def subpackages(package: str) -> dict[str, list[str]]:
    """Return the public modules of each subpackage of a package, by its name; those beside them under the package's."""
    folder = ROOT / "src" / package / package
    found: dict[str, list[str]] = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        if any(part.startswith("_") for part in parts) or LEFT_OUT & set(parts):
            continue
        room = ".".join((package, *parts[:-1][:1]))
        found.setdefault(room, []).append(".".join((package, *parts)))
    return found


def purpose(name: str) -> str:
    """Return the first line of the docstring of a package or module."""
    path = ROOT / "src" / name.partition(".")[0] / name.replace(".", "/")
    text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
    found = re.search(r'^"""(.*?)(?:"""|$)', text, re.MULTILINE)
    return found[1].rstrip() if found else ""


def reference() -> Iterator[tuple[str, str]]:
    """Yield name and text of each page of the Python reference, made from the docstrings."""
    contents = ["# Python\n\nThe modules of each subpackage, from their docstrings.\n"]
    for package in PACKAGES:
        contents.append(f"\n## {package}\n\n| subpackage | content |\n|---|---|\n")
        for room, modules in subpackages(package).items():
            page = f"api/{room}.md"
            contents.append(f"| [`{room}`]({page}) | {purpose(room)} |\n")
            yield page, "\n".join([f"# {room}", "", purpose(room), "", *(f"::: {name}\n" for name in modules)])
    yield "api.md", "".join(contents)


def target(source: str, page: str, link: str) -> tuple[str, str]:
    """Return where a link of a page leads, and the file of the repository if that has to be put into the site.

    Parameters
    ----------
    source : str
        Document of the repository that has the link.
    page : str
        Page of the site that is made from it.
    link : str
        Path relative to the document.
    """
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), link))
    if path in PAGES:
        place, file = PAGES[path], ""
    elif path.startswith("docs/"):
        place, file = path.removeprefix("docs/"), ""
    else:
        place, file = f"source/{path}", path
    return posixpath.relpath(place, posixpath.dirname(page) or "."), file


def for_site(source: str, page: str, text: str) -> tuple[str, set[str]]:
    """Return the text of a document with links for the site, and the files of the repository that they lead to."""
    files: set[str] = set()

    def replaced(found: re.Match[str]) -> str:
        if (ROOT / posixpath.dirname(source) / found[1]).is_dir():
            return found[0]
        place, file = target(source, page, found[1])
        files.update({file} - {""})
        return place + (found[2] or "")

    parts = re.split(r"(^```.*?^```)", text, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [LINK.sub(replaced, without_folders(source, part)) for part in parts[::2]]
    return "".join(parts), files


def without_folders(source: str, text: str) -> str:
    """Return a text in which links to folders, which the site does not have, are their words alone."""

    def replaced(found: re.Match[str]) -> str:
        return found[1] if (ROOT / posixpath.dirname(source) / found[2]).is_dir() else found[0]

    return re.sub(r"\[([^\]]*)\]\(([^):#\s]+)\)", replaced, text)


def listed(nav: Any) -> Iterator[str]:
    """Yield the pages of a navigation, or of a part of it."""
    if isinstance(nav, str):
        yield nav
    for part in nav.values() if isinstance(nav, dict) else nav if isinstance(nav, list) else ():
        yield from listed(part)


def on_config(config: Any) -> Any:
    """List pages of docs/ that the navigation does not name at the end of its how-tos (called by MkDocs)."""
    [how_to] = [part["How to"] for part in config.nav if "How to" in part]
    known = set(listed(config.nav))
    how_to += [path.name for path in sorted((ROOT / "docs").glob("*.md")) if path.name not in known]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages from other folders, the Python reference, and the files that pages link to (called by MkDocs)."""
    from mkdocs.structure.files import File  # noqa: PLC0415  # the rest is used without MkDocs, by tests

    files.append(File.generated(config, STYLE.name, abs_src_path=str(STYLE)))
    for page, text in reference():
        files.append(File.generated(config, page, content=text))
    linked: set[str] = set()
    documents = dict(PAGES)
    own = (file.src_uri for file in files.documentation_pages() if not file.generated_by)
    documents.update({f"docs/{page}": page for page in own})
    for source, page in documents.items():
        text, named = for_site(source, page, (ROOT / source).read_text(encoding="utf-8"))
        linked |= named
        if (existing := files.get_file_from_path(page)) is not None:
            files.remove(existing)
        files.append(File.generated(config, page, content=text))
    for path in sorted(linked):
        files.append(File.generated(config, f"source/{path}", abs_src_path=str(ROOT / path)))
    return files
