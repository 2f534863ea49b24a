# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""ROS arguments of `bringup`, `--ros-args ...`, for the nodes of one sensor, whether they share a process or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from posfet_model.command_line import checked_namespace
from posfet_model.config import ConfigError

_BEGIN: Final = "--ros-args"
_REMAP: Final = ("-r", "--remap")
_PARAMETER: Final = ("-p", "--param")


@dataclass(frozen=True)
class RosArguments:
    """What the ROS arguments say about the nodes: their namespace, their names, and all else as it was given."""

    namespace: str = ""
    """Namespace of `-r __ns:=`, without slashes at its ends; '': the root. The argument `namespace` is below it."""
    prefix: str = ""
    """Name of `-r __node:=`: nodes cannot share a name, so that it precedes the name of each."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Names of `-r <node>:__node:=`, by the name of the node."""
    words: tuple[str, ...] = ()
    """The other ROS arguments, `--ros-args` first; empty if there are none."""

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters that `-p` sets, of whichever nodes."""
        rules = [rule for option, rule in pairwise(self.words) if option in _PARAMETER]
        return [rule.partition(":=")[0].rpartition(":")[2] for rule in rules]

    @property
    def parameter_files(self) -> list[str]:
        """Paths of the files of `--params-file`."""
        return [path for option, path in pairwise(self.words) if option == "--params-file"]

    def name(self, node: str) -> str:
        """Return the name of a node of the graph."""
        return self.names.get(node) or (f"{self.prefix}_{node}" if self.prefix else node)

    def within(self, namespace: str) -> str:
        """Return the full namespace of nodes, without slashes at its ends.

        Raises ConfigError, one line, if it is not valid.

        Parameters
        ----------
        namespace : str
            The argument `namespace`; with a slash at the front it is absolute.
        """
        name = checked_namespace(namespace)
        return f"{self.namespace}/{name}" if self.namespace and not namespace.startswith("/") else name


def split(words: Sequence[str]) -> tuple[list[str], RosArguments]:
    """Return the words of a command line that ROS does not take, and its ROS arguments.

    Raises ConfigError, one line, for names and namespaces that are not valid; ROS itself checks all else.

    Parameters
    ----------
    words : sequence of str
        Command line without the program.
    """
    rest: list[str] = []
    kept: list[str] = []
    given: dict[str, str] = {}
    inside = False
    remaining = iter(words)
    for word in remaining:
        if word == _BEGIN or (inside and word == "--"):
            inside = word == _BEGIN
        elif not inside:
            rest.append(word)
        elif word in _REMAP:
            rule = next(remaining, None)
            target, separator, value = (rule or "").partition(":=")
            if separator and target.rpartition(":")[2] in {"__node", "__ns", "__name"}:
                given.setdefault(target.replace("__name", "__node"), value)  # ROS takes the first rule that matches
            else:
                kept += [word] if rule is None else [word, rule]
        else:
            kept.append(word)
    namespace = given.pop("__ns", "").strip("/")
    prefix = given.pop("__node", "")
    names = {target.removesuffix(":__node"): value for target, value in given.items()}
    for target, value in names.items():
        if target.endswith(":__ns"):
            raise ConfigError(f"{target}:={value}: the nodes of a sensor share one namespace, use namespace:=<name>")
    for name in (prefix, *names.values()):
        if name and (checked_namespace(name) != name or "/" in name):
            raise ConfigError(f"__node: must be a name without slashes, got '{name}'")
    arguments = RosArguments(
        checked_namespace(namespace) if namespace else "", prefix, names, (_BEGIN, *kept) if kept else ()
    )
    return rest, arguments
