# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The part of YAML that the files of the stack need: mappings, lists, texts, numbers, true, false and null.

A small file must not cost much: anchors with aliases, which multiply, and tags are refused, nesting and the number of
values are limited, and so is the length of a number. Dates are texts.
"""

from __future__ import annotations

import re
from typing import Any, Final

import yaml
from yaml.composer import Composer
from yaml.constructor import SafeConstructor
from yaml.parser import Parser
from yaml.reader import Reader
from yaml.resolver import Resolver
from yaml.scanner import Scanner

from posfet_model._lib.shown import MAX_SHOWN, one_line

MAX_DEPTH: Final = 16
"""Largest nesting of lists and mappings; the files of the stack need 6."""

MAX_DIGITS: Final = 100
"""Largest length of a number."""

BYTES_PER_VALUE: Final = 3
"""A text may have one value in so many characters; the files of the stack need 8 and more."""

_TIMESTAMP: Final = "tag:yaml.org,2002:timestamp"

_LEADING_ZERO: Final = re.compile(r"[-+]?0[0-9_]+")
"""Whole numbers that YAML 1.1 reads in base 8 and YAML 1.2 in base 10."""


class YamlError(ValueError):
    """Raised for text that is no YAML or has what is not allowed; the message is one line with the place."""


class _PythonParser(Reader, Scanner, Parser):
    """Makes events of a text as `yaml.cyaml.CParser` does."""

    def __init__(self, text: str) -> None:
        Reader.__init__(self, text)
        Scanner.__init__(self)
        Parser.__init__(self)


# The parser in C takes a tenth of the time, which saves 20 ms at start-up; not every build of PyYAML has it.
_Parser: Any = getattr(getattr(yaml, "cyaml", None), "CParser", _PythonParser)


class _Loader(Composer, _Parser, SafeConstructor, Resolver):  # type: ignore[misc]  # known at run time only
    """Composer in Python, before that of the parser in C: that one recurses without a limit, until the stack ends."""

    yaml_implicit_resolvers = {  # noqa: RUF012  # as in PyYAML
        first: [(tag, pattern) for tag, pattern in resolvers if tag != _TIMESTAMP]
        for first, resolvers in Resolver.yaml_implicit_resolvers.items()
    }

    def __init__(self, text: str) -> None:
        _Parser.__init__(self, text)
        Composer.__init__(self)
        SafeConstructor.__init__(self)
        Resolver.__init__(self)
        self._depth = 0
        self._values_left = 100 + len(text) // BYTES_PER_VALUE

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise _error("anchors and aliases (& and *) are not allowed", event)
        if event.tag is not None:
            raise _error("tags (!) are not allowed", event)
        self._values_left -= 1
        if self._values_left < 0:
            raise _error("more values than a file of this size may have", event)
        if self._depth == MAX_DEPTH:
            raise _error(f"nested more than {MAX_DEPTH} times", event)
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            if key_node.tag != "tag:yaml.org,2002:str":
                what = (
                    f"key {one_line(key_node.value, MAX_SHOWN)}"
                    if isinstance(key_node, yaml.ScalarNode)
                    else "a list or mapping as key"
                )
                raise _error(f"{what} is not text", key_node)
            if key_node.value in seen:
                raise _error(f"key '{one_line(key_node.value, MAX_SHOWN)}' is given twice", key_node)
            seen.add(key_node.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping

    def construct_number(self, node: yaml.ScalarNode) -> float:
        """Return a number without the quadratic cost of one in base 60, which 1:30 is in YAML."""
        if len(node.value) > MAX_DIGITS:
            raise _error(f"a number of more than {MAX_DIGITS} characters", node)
        whole = node.tag.endswith("int")
        if whole and _LEADING_ZERO.fullmatch(node.value):
            raise _error(
                f"a leading zero: '{node.value}' is a number in base 8 to some and in base 10 to others; "
                "write it without the zero, or a text in quotes",
                node,
            )
        try:
            return self.construct_yaml_int(node) if whole else self.construct_yaml_float(node)
        except (ValueError, OverflowError):  # 0o8, or base 60 beyond the largest number
            raise _error(f"'{one_line(node.value, MAX_SHOWN)}' is not a number", node) from None


for _tag in ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float"):
    _Loader.add_constructor(_tag, _Loader.construct_number)


def parse(text: str) -> object:
    """Return the value of a YAML text.

    Parameters
    ----------
    text : str
        The text; its length bounds time and memory.

    Raises
    ------
    YamlError
        It is not valid YAML, or has an anchor, an alias, a tag, a key that is no text or is given twice, too deep
        nesting, too many values, too long a number, or a whole one with a leading zero.
    """
    try:
        loader = _Loader(text)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise YamlError(f"{error.problem}{place}") from error
    except (yaml.YAMLError, ValueError) as error:  # characters that YAML does not allow
        raise YamlError(" ".join(str(error).split())) from error


def _error(problem: str, place: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=place.start_mark)
