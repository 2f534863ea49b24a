# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What `posfet design` says of a sweep: how many designs are valid, why the others are not, and the Pareto front."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from posfet_model.design.sweep import OBJECTIVES, SweepResult

FRONT_ROWS: Final = 20
"""Most designs of a Pareto front that are printed; all are in the CSV file."""


def as_json(result: SweepResult) -> dict[str, Any]:
    """Return the summary of a sweep for JSON.

    Parameters
    ----------
    result : SweepResult
        The sweep.

    Returns
    -------
    dict
        Counts of designs, of valid ones and of reasons, and the fields and objectives of the Pareto front.
    """
    front = np.flatnonzero(result.pareto)
    front = front[np.argsort(-result.figures["snr_db"][front], kind="stable")]
    columns = {**result.fields, **result.figures}
    return {
        "designs": int(result.valid.size),
        "valid": int(result.valid.sum()),
        "reasons": result.reasons,
        "pareto_front": [{key: float(columns[key][i]) for key in (*result.fields, *OBJECTIVES)} for i in front],
    }


def as_text(summary: dict[str, Any], path: Path) -> str:
    """Return the summary of a sweep for people.

    Parameters
    ----------
    summary : dict
        What `as_json` returns.
    path : Path
        CSV file with all designs.

    Returns
    -------
    str
        Lines, without a final line break.
    """
    best = summary["pareto_front"]
    lines = [
        f"{summary['designs']} designs, {summary['valid']} valid, {len(best)} on the Pareto front of "
        f"{', '.join(OBJECTIVES)} (the most of the first two, the least of the others)"
    ]
    lines += [f"  {count} not valid: {reason}" for reason, count in summary["reasons"].items()]
    if not best:
        return "\n".join(lines)
    width = {key: max(12, len(key)) for key in best[0]}
    lines.append("  ".join(f"{key:>{w}}" for key, w in width.items()))
    lines += ["  ".join(f"{row[key]:>{w}.5g}" for key, w in width.items()) for row in best[:FRONT_ROWS]]
    if len(best) > FRONT_ROWS:
        lines.append(f"... and {len(best) - FRONT_ROWS} more, marked in the column pareto of {path}")
    return "\n".join(lines)
