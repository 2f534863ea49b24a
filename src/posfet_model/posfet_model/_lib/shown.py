# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Values from outside in messages: always short and in one line, and never made at their full size; ranges."""

from __future__ import annotations

import math
from reprlib import Repr
from typing import Final

MAX_SHOWN: Final = 60
"""Largest length of a value in a message."""

MAX_LINE: Final = 4000
"""Largest length of a path in a message."""


class _ShortRepr(Repr):
    """Representation of a value of any size, made without one of its full size."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = 2 * MAX_SHOWN
        self.maxlist = self.maxtuple = self.maxdict = MAX_SHOWN // 3
        self.maxlevel = 3

    def repr_int(self, x: int, level: int) -> str:
        """Return the digits; Python refuses to write out more than 4300."""
        return repr(x) if x.bit_length() < 10_000 else f"a whole number of {x.bit_length()} bits"


def shown(value: object) -> str:
    """Return a value for an error message, in one line of at most `MAX_SHOWN` characters."""
    text = "nothing" if value is None else _ShortRepr().repr(value)
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


def one_line(text: str, limit: int = MAX_LINE) -> str:
    r"""Return a text from outside, such as a file name, so that it fits into a message of one line.

    Parameters
    ----------
    text : str
        The text.
    limit : int, optional
        Largest length.

    Examples
    --------
    >>> print(one_line("left\nthumb.yaml"))
    left\nthumb.yaml
    """
    cut = text if len(text) <= limit else f"{text[: limit - 3]}..."
    return cut if cut.isprintable() else repr(cut)[1:-1]


def interval(low: float, high: float, exclusive: bool = False) -> str:
    """Return the notation of an interval: closed ends in brackets, open and infinite ends in parentheses.

    Parameters
    ----------
    low : float
        Lower end of the range.
    high : float
        Upper end of the range.
    exclusive : bool, optional
        Whether the ends are excluded.
    """
    left = "(" if exclusive or math.isinf(low) else "["
    right = ")" if exclusive or math.isinf(high) else "]"
    return f"{left}{low:g}, {high:g}{right}"
