"""The numbers shown in docstrings and documents are what the code prints."""

import doctest
import importlib
from pathlib import Path

import pytest

import posfet_model

PACKAGE = Path(posfet_model.__file__).parent
DOCUMENTS = Path(__file__).resolve().parents[2] / "docs"
EXAMPLE = ">>> "


def _modules() -> list[str]:
    return [
        ".".join(("posfet_model", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in sorted(PACKAGE.rglob("*.py"))
        if EXAMPLE in path.read_text(encoding="utf-8")
    ]


@pytest.mark.parametrize("name", _modules())
def test_examples_of_a_module(name: str) -> None:
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("path", sorted(DOCUMENTS.glob("*.md")), ids=lambda path: path.name)
def test_examples_of_a_document(path: Path) -> None:
    assert doctest.testfile(str(path), module_relative=False, encoding="utf-8").failed == 0
