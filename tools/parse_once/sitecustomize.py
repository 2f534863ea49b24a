# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Let the generators of ROS 2 messages parse each interface file once, instead of once per generator.

Python imports this module at its start while `tools/build.sh` has this folder in PYTHONPATH. A generator spends nine
tenths of its time in the parser of interface files, and ten of them read the same files. The parsed form of a file is
kept in the folder POSFET_PARSED, under a hash of its text and of the parser's version. Without that variable nothing is
changed.
"""

from __future__ import annotations

import fcntl
import gc
import hashlib
import os
import pickle
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

PARSER = "rosidl_parser.parser"


class ParseOnce(MetaPathFinder):
    """Finds the parser where it is, and gives it a memory as soon as it is imported."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return the specification of the parser, None for any other module."""
        if fullname != PARSER:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            folder = Path(os.environ["POSFET_PARSED"])
            module.parse_idl_string = remembering(module.parse_idl_string, module.grammar, folder)

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def remembering(parse: Callable[..., Any], grammar: str, folder: Path) -> Callable[..., Any]:
    """Return a function like `parse` that keeps what it has parsed in a folder, for this and other processes.

    Parameters
    ----------
    parse : callable
        Parses the text of an interface file.
    grammar : str
        Grammar of the parser.
    folder : Path
        Folder for the results; made if there is none.
    """

    def parse_once(text: str, png_file: str | None = None) -> Any:
        if png_file is not None:
            return parse(text, png_file)
        folder.mkdir(parents=True, exist_ok=True)
        key = hashlib.sha256("\0".join([text, grammar, sys.version]).encode()).hexdigest()
        with (folder / key).open("a+b") as file:
            fcntl.flock(file, fcntl.LOCK_EX)  # generators run side by side: one parses, the others wait for it
            file.seek(0)
            with suppress(EOFError, pickle.UnpicklingError):  # empty, or cut off when a build was killed
                return pickle.load(file)
            gc.disable()  # millions of objects, hardly any garbage: looking for it takes an eighth of the time
            try:
                parsed = parse(text)
            finally:
                gc.enable()
            file.truncate(0)
            pickle.dump(parsed, file)
            return parsed

    return parse_once


if "POSFET_PARSED" in os.environ:
    sys.meta_path.insert(0, ParseOnce())
