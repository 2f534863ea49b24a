# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Runtime-accuracy trade-off of integration schemes for the charge with leakage, in float64 and float32, for a tap."""

from __future__ import annotations

import numpy as np

from benchmarks.outcome import Chart, Outcome, Point, Table
from benchmarks.simulation.runs import REFERENCE_RATE, SCHEMES, SENSOR, exact_hold, march, scheme_forces


def measure(full: bool) -> Outcome:
    """Integrate with each scheme, step size and dtype."""
    strides = (10, 30, 100, 300, 1000) if full else (30, 100, 300)
    forces = scheme_forces()
    per_second = 1 / SENSOR.device.leak_time_constant
    finest = 1 / REFERENCE_RATE
    exact = march(exact_hold, forces, finest * per_second)[0]
    series: dict[str, list[Point]] = {}
    rows = []
    for title, scheme in SCHEMES.items():
        for dtype in (np.float64, np.float32):
            for stride in strides:
                step = stride * finest
                values, seconds = march(scheme, forces[::stride].astype(dtype), step * per_second)
                error = 100 * float(np.abs(values - exact[::stride][: len(values)]).max()) / SENSOR.device.force_max
                cost = seconds / (len(values) * step)
                label = f"{title}, {np.dtype(dtype).name}"
                rows.append((label, step * 1e3, cost, error))
                series.setdefault(label, []).append((cost, max(error, 1e-9), f"{step * 1e3:g} ms"))
    columns = ("scheme", "step ms", "run time in s per simulated s, 4096 taxels", "maximum error, % of full scale")
    chart = Chart("front_schemes", "Charge with leakage, 4096 taxels; reference: exact at 0.01 ms",
                  "run time [s per simulated s]", "maximum error [% of full scale]", series)  # fmt: skip
    values = {"scheme_first_order_hold_1ms_error_pct": next(
        row[3] for row in rows if row[0] == "first-order hold, float64" and abs(row[1] - 1.0) < 1e-9
    )}  # fmt: skip
    return Outcome(values, [Table("Integration schemes", columns, rows)], [chart])
