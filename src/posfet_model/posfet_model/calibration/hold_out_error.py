# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Prediction error of a calibration on the part of its recording that was not fitted."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array
from posfet_model.calibration.bench_signals import STRETCH, fitted_blocks
from posfet_model.calibration.fit_steps import FitSteps
from posfet_model.calibration.leaky_response import block_means, compensated
from posfet_model.calibration.response_fit import ResponseFit
from posfet_model.calibration.taxel_calibration import Residuals


def hold_out_error(steps: FitSteps, found: ResponseFit) -> Residuals:
    """Return the prediction error on the hold-out set as forces, with the fit and with nominal parameters.

    Forces with the leakage compensated from the first scan on, 20 ms means; the film's temperature is that of the
    untouched taxels. Start and offset, of which the latter is a slope here, are those of the training set in both: an
    uncalibrated model learns its baselines, too.

    Parameters
    ----------
    steps : FitSteps
        What was found.
    found : ResponseFit
        The fit.

    Returns
    -------
    Residuals
        The error.
    """
    bench = steps.bench

    def error(charge: Array) -> Array:
        fitted = block_means(charge, bench.size)
        line = np.polynomial.Polynomial.fit(time[~held_out], fitted[~held_out], 1)
        difference: Array = (fitted - line(time))[held_out]
        return difference

    time = block_means(bench.time, bench.size)
    held_out = ~fitted_blocks(time)
    nominal_tau = bench.sensor.device.leak_time_constant
    after, before, samples = np.zeros(held_out.sum()), np.zeros(held_out.sum()), 0
    for taxel in steps.alive:
        each = found.taxels[taxel]
        force, signal = bench.force[:, taxel], bench.signal[:, taxel]
        source = steps.charge(taxel, found) + steps.shares[taxel] * steps.common
        fitted = error(compensated(bench.time, signal, 1.0 / each.rate) - source) / each.gain
        nominal = error(compensated(bench.time, signal, nominal_tau) - force - steps.common)
        after, before = after + fitted**2, before + nominal**2
        samples += len(fitted)
    alive = max(len(steps.alive), 1)
    stretch = (time[held_out] / STRETCH).astype(np.intp)
    starts, index, counts = np.unique(stretch, return_inverse=True, return_counts=True)
    over_time = [np.sqrt(np.bincount(index, weights=each) / counts / alive) for each in (after, before)]
    return Residuals(
        force_rms=float(np.sqrt(after.sum() / max(samples, 1))),
        force_rms_before=float(np.sqrt(before.sum() / max(samples, 1))),
        samples=samples * bench.size * bench.thinning,
        time=starts.astype(np.float64) * STRETCH,
        force_rms_over_time=over_time[0],
        force_rms_before_over_time=over_time[1],
    )
