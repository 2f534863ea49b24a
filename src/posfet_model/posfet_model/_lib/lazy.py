# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Submodules as attributes of their package, imported when they are first used."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from functools import cache
from types import ModuleType


def lazy_submodules(package: str, path: Iterable[str]) -> tuple[Callable[[str], ModuleType], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` of a package whose submodules are attributes, each imported on first use.

    Parameters
    ----------
    package : str
        Name of the package, its ``__name__``.
    path : iterable of str
        Folders of the package, its ``__path__``.

    Returns
    -------
    tuple of callable
        `__getattr__` and `__dir__`.
    """

    @cache
    def listing() -> list[str]:
        import pkgutil  # noqa: PLC0415  # most modules are imported by their names

        return sorted(module.name for module in pkgutil.iter_modules(path) if not module.name.startswith("_"))

    def get(name: str) -> ModuleType:
        if name in listing():
            return importlib.import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return get, listing
