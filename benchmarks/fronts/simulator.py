# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""ngspice on one follower or many, with the processor time of its transient analysis alone."""

from __future__ import annotations

import resource
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from posfet_model.spice import ngspice

OPTIONS = "method=gear abstol=1e-14 vntol=1e-9 chgtol=1e-18 trtol=1 gmin=1e-15"
"""Those of posfet_model.spice.ngspice; the tolerance is added."""


def transient(
    text: str, sources: Sequence[str], stop: float, largest: float, tolerance: float, runs: int = 1
) -> tuple[ngspice.Transient, float]:
    """Simulate one follower for each source; return the last one and the processor time of a run [s].

    With several runs in one process, the time is what each costs more than the first: start, parsing and operating
    point of the first do not count. With one it is the time that ngspice reports for the transient analysis, in whole
    milliseconds, times the processor share of the process, as that report is in wall-clock time.
    """
    if runs > 1:
        (_, base, _), (run, whole, _) = (_run(text, sources, stop, largest, tolerance, count) for count in (1, runs))
        return run, max((whole - base) / (runs - 1), 1e-6)
    run, spent, share = _run(text, sources, stop, largest, tolerance, 0)
    return run, max(spent * share, 1e-6)


def _run(
    text: str, sources: Sequence[str], stop: float, largest: float, tolerance: float, repeat: int
) -> tuple[ngspice.Transient, float, float]:
    """Return the last follower, a time and its processor share: of the process, or without `repeat` as reported."""
    lines = ["followers", text]
    for k, source in enumerate(sources):
        lines += [f"vin{k} in{k} 0 {source}", f"x{k} in{k} out{k} out{k} opamp"]
    last = len(sources) - 1
    analysis, saved = f"tran {largest:.12g} {stop:.12g} 0 {largest:.12g}", f"v(in{last}) v(out{last})"
    lines += [f".options acct {OPTIONS} reltol={tolerance:g}", f".save {saved}"]
    if repeat:
        again = [*[f"{analysis}\ndestroy all"] * (repeat - 1), analysis]
        lines += [".control", "set filetype=binary", *again, f"write out.raw {saved}", "quit", ".endc"]
    else:
        lines.append(f".{analysis}")
    with tempfile.TemporaryDirectory(prefix="posfet-fronts-") as folder:
        (Path(folder) / "deck.cir").write_text("\n".join([*lines, ".end", ""]), encoding="ascii")
        command = [ngspice.PROGRAM, "-n", "-b", *([] if repeat else ["-r", "out.raw"]), "deck.cir"]
        processor, clock = _children(), time.perf_counter()
        done = subprocess.run(command, cwd=folder, check=False, capture_output=True, text=True)
        spent, wall = _children() - processor, time.perf_counter() - clock
        content = Path(folder) / "out.raw"
        if not content.exists():
            raise ngspice.SpiceError(f"ngspice wrote no result: {done.stdout[-300:]} {done.stderr[-300:]}")
        values = ngspice.read_raw(content.read_bytes(), complex_values=False).real
    run = ngspice.Transient(*(np.array(row) for row in values[-3:]))
    if repeat:
        return run, spent, 1.0
    account = dict(line.split(" = ", 1) for line in done.stdout.splitlines() if line.count(" = ") == 1)
    return run, float(account["Transient analysis time"]), spent / wall


def _children() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
