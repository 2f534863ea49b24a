# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Messages that are loaded when they are used, for a process that starts quickly.

The packages of messages load every message they have: 120 files for the dozen messages that a stack publishes, a
quarter of its imports. Only programs of this project load them on demand, before they import rclpy; a program that
imports this project as a library is left alone.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from importlib.abc import Loader

INTERFACES: Final = re.compile(r"\w+_(?:msgs|interfaces)\.(?:msg|srv|action)")
"""Names of the Python packages with the messages, services and actions of a ROS package."""
LINE: Final = re.compile(r"from (\S+) import (\w+)\s*(?:#.*)?")
"""What each line of such a package is."""
GENERATOR: Final = "rosidl_generator_py.generate_py_impl"
"""Makes Python code of messages, with a parser; where it is missing, its package goes on without it."""


class _OnDemand(SourceFileLoader):
    """Loads a package whose lines import a name each, without doing it."""

    def exec_module(self, module: ModuleType) -> None:
        """Let the names be imported when they are used; execute a package that does anything else as it is."""
        lines = [line for line in self.get_data(self.path).decode().splitlines() if line.strip()]
        found = [LINE.fullmatch(line) for line in lines]
        places = {match[2]: match[1] for match in found if match}
        if None in found:
            super().exec_module(module)
            return

        def use(name: str) -> Any:
            if name not in places:
                raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")
            value = getattr(import_module(places[name]), name)
            setattr(module, name, value)
            return value

        module.__dict__.update(__all__=list(places), __getattr__=use, __dir__=lambda: sorted(places))


class _Finder:
    """Finds the packages of messages."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a package of messages is; None for anything else."""
        if not INTERFACES.fullmatch(fullname):
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        loader: Loader | None = spec.loader if spec else None
        if spec and isinstance(loader, SourceFileLoader):
            spec.loader = _OnDemand(loader.name, loader.path)
        return spec


def load_on_demand() -> None:
    """Load messages when they are used, from here on."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())
        sys.modules.setdefault(GENERATOR, None)  # type: ignore[arg-type]  # not to be found
