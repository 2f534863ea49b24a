# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scan rates, classic frames of 12 bit against CAN FD of 16 bit, and sizes of the array."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from benchmarks.fronts.estimators import STACK
from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.fronts.pipeline import A_PEER, Method, Other, Stack, peers, run
from benchmarks.fronts.recordings import HEADINGS, record
from benchmarks.outcome import shown
from benchmarks.peers.taxel_kalman import TaxelKalman
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.scene import load_scene

RATES = (100, 250, 500, 1000, 2000, 4000, 8000)
CLASSIC_RATES = (100, 250, 500, 1000)
"""Scan rates [Hz]; classic frames of 25 taxels at 1 Mbit/s end near 1 kHz."""

SIZES = ("posfet_16x16", "posfet_32x32")
SCENE, SECONDS, SECONDS_LARGE = "press_slide_lift", 4.0, 1.6
SEED = 3


def noisy() -> ErrorModel:
    """Return a board with the noise of the default one and no other error, so that rates and formats show."""
    default = ErrorModel.default()
    return replace(ErrorModel.none(), thermal_noise=default.thermal_noise, flicker_noise=default.flicker_noise)


def measure(effort: Effort) -> list[Front]:
    """Return the fronts of rates and formats, and of sizes."""
    return [_rates(effort), *([] if effort.short else [_size(name, effort) for name in SIZES])]


def _stack(sensor: Sensor) -> Method:
    return lambda known: Stack(Reconstructor(sensor, known))


def _measured(
    sensor: Sensor, makers: Mapping[tuple[str, str], Method], seconds: float, effort: Effort
) -> tuple[list[Choice], int, int]:
    """Return choices with the cost of a scan, and the number of scans recorded and expected."""
    recording = record(sensor, load_scene(SCENE, sensor), seconds, SEED, noisy())
    nominal = Calibration.nominal(sensor)
    runs = [run(makers, [recording], nominal, sensor, judged=k == 0) for k in range(min(effort.repeats, 2))]
    choices = [
        Choice(*key, runs[0][key][0].force_percent, tuple(each[key][1] for each in runs), runs[0][key][0].figures)
        for key in makers
    ]
    return choices, len(recording.scans), round(seconds * sensor.can.scan_rate)


def _rates(effort: Effort) -> Front:
    default = load_sensor()
    fd = RATES[2:4] if effort.short else RATES
    classic = CLASSIC_RATES[2:] if effort.short else CLASSIC_RATES
    found, counts = [], []
    for title_, rates, bits in (("CAN FD, 16 bit", fd, 16), ("classic, 12 bit", classic, 12)):
        for rate in rates:
            can = replace(default.can, scan_rate=float(rate), fd=bits == 16)
            sensor = replace(default, can=can, adc=replace(default.adc, bits=bits))
            makers = {(title_, f"{rate} Hz"): _stack(sensor)}
            if bits == 16:
                makers["Kalman filter per taxel", f"{rate} Hz"] = lambda known, s=sensor: Other(TaxelKalman(s, known))
            span = SECONDS / 2 if rate > 2000 else SECONDS
            choices, got, wanted = _measured(sensor, makers, 1.6 if effort.short else span, effort)
            counts.append(got / wanted)
            found += [replace(each, seconds=tuple(value * rate for value in each.seconds)) for each in choices]
    own = next(each for each in found if each.name == "CAN FD, 16 bit, 1000 Hz")
    other = next(each for each in found if each.name == "classic, 12 bit, 1000 Hz")
    slow = next(each for each in found if each.series == "CAN FD, 16 bit")
    checks = (
        Check("scans received of those expected, least of all rates [1]", min(counts), 0.97, 1.03),
        Check("error with 12 bit over that with 16 bit at 1 kHz [1]", other.error / own.error, 0.8, math.inf),
    )
    return Front(
        "rates",
        "Scan rate and frame format",
        "1 s of 25 taxels",
        "error of the total force while touched [%]",
        f"forces of the simulated scene {SCENE}, on a board with noise alone",
        0.0,
        tuple(found),
        own.name,
        checks,
        f"At {slow.parameter} the stack costs {shown(slow.median / own.median)} of what it costs at 1000 Hz, with "
        f"{shown(slow.error / own.error)} times the error; 12-bit readings in classic frames err "
        f"{shown(other.error / own.error)} times as much as 16-bit ones{_why_invalid(other)}. Choose the rate by the "
        "fastest contact that matters, and CAN FD for the resolution.",
        why_not={
            "Kalman filter per taxel": "This board has noise alone, which is all that this filter knows: see the whole "
            "pipeline for boards with other errors.",
            "": "This scene has no tap and no slip, which is what a high rate is for.",
        },
        question="a frame format",
        rival=other.name,
        columns=HEADINGS,
    )


def _why_invalid(other: Choice) -> str:
    """Return why 12-bit readings gave no valid force, where they did not."""
    valid = other.more[HEADINGS.index("declared valid %")]
    if valid > 0:
        return ""
    return (
        " (no force is valid: on a board without offsets all taxels switch between the same two codes, which the "
        "estimator takes for a change of temperature and restarts its offsets)"
    )


def _size(name: str, effort: Effort) -> Front:
    sensor = load_sensor(name)
    makers: dict[tuple[str, str], Method] = {(STACK, ""): _stack(sensor)}
    for peer in peers():
        makers[peer.name, ""] = lambda known, peer=peer: Other(peer(sensor, known))
    choices, got, wanted = _measured(sensor, makers, SECONDS_LARGE, effort)
    own = next(each for each in choices if each.name == STACK)
    rival = min((each for each in choices if each.series != STACK), key=lambda each: each.error)
    shape = f"{sensor.layout.rows} x {sensor.layout.cols}"
    return Front(
        f"size_{sensor.layout.rows}x{sensor.layout.cols}",
        f"Whole pipeline, array of {shape}",
        f"one scan of {shape} taxels",
        "error of the total force while touched [%]",
        f"forces of the simulated scene {SCENE}, on a board with noise alone",
        0.0,
        tuple(choices),
        STACK,
        (
            Check("scans received of those expected [1]", got / wanted, 0.97, 1.03),
            Check("missed contacts of the shipped choice [%]", own.more[1], 0.0, 5.0),
        ),
        f"With {shape} taxels the stack errs by {shown(own.error)} % and the best peer ({rival.name}) by "
        f"{shown(rival.error)} %, in {shown(rival.median / own.median)} of the run time. Choose by the errors of the "
        "whole pipeline above: this board has noise alone.",
        why_not=A_PEER,
        question=f"an array of {shape}",
        rival=rival.name,
        swept=False,
        columns=HEADINGS,
    )
