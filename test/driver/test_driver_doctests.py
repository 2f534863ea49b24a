"""Doctest of the examples in the docstrings of the driver."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import posfet_driver

PACKAGE = Path(posfet_driver.__file__).parent


def _modules() -> list[str]:
    return [
        ".".join(("posfet_driver", *path.relative_to(PACKAGE).with_suffix("").parts))
        for path in sorted(PACKAGE.rglob("*.py"))
        if ">>> " in path.read_text(encoding="utf-8")
    ]


@pytest.mark.parametrize("name", _modules())
def test_examples_of_a_module(name: str) -> None:
    result = doctest.testmod(importlib.import_module(name))
    assert result.attempted > 0
    assert result.failed == 0
