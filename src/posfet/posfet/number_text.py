# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Texts of numbers for people: no -0, and unknown as ``?``."""

from __future__ import annotations

import math


def signed(value: float, decimals: int) -> str:
    """Return a number with its sign and fixed decimals; 0 without a sign, unknown as ``?``."""
    if math.isnan(value):
        return "?"
    text = f"{value:+.{decimals}f}"
    return text[1:] if float(text) == 0.0 else text


def fixed(value: float, decimals: int) -> str:
    """Return a number with fixed decimals and no -0; unknown as ``?``."""
    if math.isnan(value):
        return "?"
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


def counted(count: int, thing: str) -> str:
    """Return "1 scan", "2 scans"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"
