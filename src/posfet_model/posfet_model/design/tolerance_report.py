# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What `posfet design` says of a tolerance analysis: yield, limits and quantiles."""

from __future__ import annotations

from typing import Any

import numpy as np

from posfet_model.design.tolerance import QUANTILES, ToleranceResult


def as_json(result: ToleranceResult) -> dict[str, Any]:
    """Return the summary of a tolerance analysis for JSON: a value that is unknown or infinite is None.

    Parameters
    ----------
    result : ToleranceResult
        The analysis.

    Returns
    -------
    dict
        Counts, yield, share within each limit, and quantiles of each figure.
    """

    def number(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return {
        "samples": int(result.valid.size),
        "valid": int(result.valid.sum()),
        "yield": result.yielded,
        "limits": {key: float(mask.mean()) for key, mask in result.passed.items()},
        "quantiles": {
            key: {f"{q:g}": number(v) for q, v in zip(QUANTILES, result.quantiles(key), strict=True)}
            for key in result.figures
        },
    }


def as_text(result: ToleranceResult) -> str:
    """Return the summary of a tolerance analysis for people.

    Parameters
    ----------
    result : ToleranceResult
        The analysis.

    Returns
    -------
    str
        Lines, without a final line break.
    """
    lines = [f"{result.valid.size} samples, {int(result.valid.sum())} valid, yield {100 * result.yielded:.1f} %"]
    lines += [f"  {key}: {100 * mask.mean():.1f} % within the limit" for key, mask in result.passed.items()]
    lines.append(f"{'quantiles':27}" + "".join(f"{100 * q:>11g} %" for q in QUANTILES))
    for key in result.figures:
        lines.append(f"{key:27}" + "".join(f"{value:>13.5g}" for value in result.quantiles(key)))
    return "\n".join(lines)
