# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stored ngspice runs of test/data/spice (made by posfet_model.spice.reference_runs and recorded_runs)."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from posfet_model.spice.ngspice import SmallSignal
from posfet_model.spice.record_file import Record, load
from posfet_model.spice.run_file import FollowerRun, read_run

FOLDER = Path(__file__).resolve().parents[1] / "data" / "spice"


def path(circuit: str, stimulus: str) -> Path:
    return FOLDER / f"{circuit}_{stimulus}.csv"


def transient(circuit: str, stimulus: str) -> FollowerRun:
    return read_run(path(circuit, stimulus))


def small_signal(circuit: str, kind: str) -> SmallSignal:
    frequency, real, imaginary = np.loadtxt(path(circuit, kind), delimiter=",", skiprows=3, unpack=True)
    return SmallSignal(frequency=frequency, transfer=real + 1j * imaginary)


@cache
def recorded(circuit: str) -> Record:
    return load(FOLDER / "circuits" / f"{circuit}.npz")
