# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The estimator of static force as it was in Python; posfet_core, estimation/force_estimator.hpp, says why."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_core.scan_path import Belief, ForceErrorFilter, Thermometers
from posfet_model._lib.types import Array, Mask
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.error_states import BENDS, COUNT, ErrorPriors, Shared
from posfet_model.estimation.settings import MAX_RELATIVE_UNCERTAINTY
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms
from reference.estimation.contact_surroundings import ContactSurroundings
from reference.estimation.error_states import SharedDynamics, start_belief, start_covariance, start_mean
from reference.estimation.held_forces import HeldForces
from reference.estimation.hidden_touch import HiddenTouch
from reference.estimation.jump_noise import QUIET, JumpNoise
from reference.estimation.known_forces import (
    GATE,
    NEGATIVE_TIME,
    RELEASED_BLOCKS,
    STILL_BLOCKS,
    ReleaseDetector,
    UnexplainedResiduals,
    UniformChange,
)
from reference.estimation.lone_drift import LoneDrift
from reference.estimation.rest_detector import RestDetector
from reference.estimation.signal_steps import HALF, signal_steps
from reference.estimation.steady_force import HOP, SteadyForce
from reference.estimation.temperature_walk import LEAST_TIME, MEMORY, TemperatureWalk
from reference.estimation.thermal_contact import ThermalContact
from reference.estimation.touch_response import TouchResponse
from reference.estimation.validity import LowerBoundMonitor
from reference.estimation.witnesses import SPACING, Witnesses
from reference.estimation.zero_refutation import EVIDENCE, PRESSED, SIGNIFICANT, SURPRISING, ZeroRefutation
from reference.reductions import any_true, median, upper_median

BLOCK: Final = 0.02
"""Duration of a block [s]."""

LAG: Final = 16
"""Number of blocks that are processed again when a touch begins: 0.3 s, assumed to be the weak part of a touch."""

SUSPECTED: Final = LAG // 2
"""Number of them from which taxels are left out that do not show the touch themselves."""

LEAST_LEAK: Final = 0.5
"""Least time constant of the leakage that is believed, relative to that of the calibration at its temperature [1]."""

RESUME_TIME: Final = 0.04
"""No force is valid for this long after an interruption [s]."""

LOST_FORCE_TIME: Final = 2.0
"""Time after which a force without which an object released counts as none after an interruption [s]."""

LONG_STEP: Final = 0.05
"""h/tau above which the time of a force change within a step matters [1]."""

RUNAWAY: Final = 4.0
"""A taxel restarts when its force exceeds this many times the greatest force of the device [1]; a saturated taxel may
exceed the greatest force."""

REJECTED: Final = 3.0
"""Factor on the prior deviation of the residual charge after that prior was rejected [1]."""

RESTART_DEVIATION: Final = 0.1
"""Standard uncertainty of an offset that was known when its taxel restarted [contact threshold]."""

OFFSET_SPREAD: Final = 2.0
"""Greatest deviation of an untouched taxel's offset from the median offset [contact threshold]; a larger one requires a
longer rest."""

BEGUN: Final = 0.51
"""Sum of the shares of the force up to which the touch has just begun [1]: no sum of plays alone."""

LARGEST_LAG_STEP: Final = 0.5
"""Greatest change of the logarithm of the sensors' lag by one reading [1]: the lag is nearly linear in it, then."""

STATUS_INTERVAL: Final = 0.1
"""Interval of the readings of the temperature sensors before it is known [s]: that of board status."""

REPEATED: Final = 3.0
"""Time after which a reading of the temperature sensors that has not changed counts again [intervals]."""

SAME_ERROR: Final = 1.0
"""Time for which the rounding error of such a reading is the same [s], assumed: it counts for no more in that time."""

TAIL_NOISE: Final = 5e-7
"""Variance of the force of a taxel beside a contact in a block, in addition to shares of its neighbours' [N2]."""

NOTICEABLE: Final = 0.3
"""Share of the contact threshold that a taxel must read before a scan is tested for a uniform change [1]."""

OF_TOUCH: Final = np.isin(
    np.arange(COUNT), (Shared.LEAK, Shared.WARMTH, Shared.WEAK_WARMTH, *range(Shared.CREEP, COUNT))
)
"""Mask of the responses of a taxel to its own force. Those of a taxel beside a contact are part of its small force, and
tell nothing of the shared states."""

LEAST_DEVIATION: Final = 1.0
"""Deviation of the total force that is always accepted [contact threshold]."""

HOTTEST: Final = 1e3
"""Change of its temperature that no film survives [K]: a taxel whose response to it would not matter has none."""

GREATEST_WARMTH: Final = 0.08
"""Warmth of touched taxels, with its deviation, above which their forces are not valid [K]: force and warmth are hardly
separable then."""

BEYOND_RANGE: Final = 1.25
"""Force above which a taxel is not valid [greatest force]: one of a small gain shows more than the nominal one."""

OF_OBJECT: Final = COUNT + 3
"""Which of the causes of errors that the forces share is the object that touches."""

NONLINEARITY: Final = 0.01
"""Change of the gain per force on a taxel [1/N], assumed: with the preload of the film, the charge per small force
grows by up to two per cent per newton, half of which counts for the force itself."""

NEGLIGIBLE: Final = 1e-12
"""Variance of a pyroelectric response that is known exactly [1]: not 0, to divide by."""

PLAY: Final = 4.0
"""Deviations of a block's mean by which a force must change to have moved [1]."""
SHARE_PLAY: Final = 2e-3
"""Greatest change of a taxel's share of the force that is no motion [1]: the deviation of its force, between these."""
GREATEST_SHARE_PLAY: Final = 0.02
"""What changes more has moved, however uncertain the force is [1]."""

UNKNOWN_TAIL: Final = 0.15
"""Variance of a common tail of which nothing is known [1], assumed: as after all the force has moved."""

EARLY: Final = 2.0
"""Time in which readings show at what rate the film has warmed since before the start [s]: it is constant."""
WARMED: Final = 0.05
"""Share of the warmth of a touch from which the film of a taxel may be warm [1]."""
HOTTEST_OBJECT: Final = 15.0
"""Greatest difference of temperature between an object and the film [K], assumed: a hand on a cold robot."""
WARMING_TIMES: Final = 2.0
"""Time that a touch must last to show what it warms, in time constants of that warmth [1]."""
COOLED: Final = 4.0
"""Time constants after which the film is no longer warm [1]."""
HIDES: Final = 2.0
"""What warmth hides, over the force that causes most of it, from which on such forces come and go [1]."""
RECOVERING: Final = 1.0
"""Time in which a film may recover from a force that no response knows by as much as it creeps [s], assumed."""

RELEASING: Final = 0.9
"""Share of the greatest force of the last blocks below which the force falls as in a release [1]."""
DECIDED: Final = 1.5
"""Blocks from the middle of one, whose force is known, to the end of the next, for which it decides [1]."""

BRIEF: Final = 2.0
"""By how much the film may answer more to a force within a block than to one that lasts, in sizes of its fastest slow
response [1]; assumed."""
TAP_SHARE: Final = 0.25
"""Share of a force that a tap has lost from one block to the next [1]; warmth takes a second for it."""
ABSORBED_TIME: Final = 5.0
"""Time over which the baseline is averaged that a slow press is compared with [s], twice the time constant of that
average; less for as long after a touch, as what its end tells of the errors is no slow press."""


@dataclass
class Block:
    """What a block measured: kept until no touch can have begun in it."""

    mean: Array
    """Mean of the uncorrected forces F^ [N]."""
    noise: Array
    """Variance of its noise [N2]."""
    duration: float
    """Its duration [s]."""
    charge: Array
    """Mean of the charge, as a force, up to a constant [N]."""
    span: float
    """Time from the middle of the block before to its own [s]."""
    reading: float
    """New mean reading of the temperature sensors [K]; NaN: none."""
    reading_variance: float
    """Variance of its noise [K2]."""
    interval: float
    """Time since the reading before [s]."""
    leaked_time: float
    """Time since the temperatures began, as one with the leak rates of the calibration [s]: offsets have leaked for
    so long."""
    listed: Mask
    """Taxels in contact."""
    touched: Mask
    """These, and those whose residual was unexplained."""
    response: Array
    """Responses of the force errors to the shared states, shape [taxels, COUNT]."""
    neighbour: Array
    """Greatest force of a neighbour [N]; 0 where nothing touches."""
    tail: Array
    """Force of an untouched taxel if forces declined geometrically away from the contact [N]."""
    moved_share: float
    """Share of the force that has moved from taxel to taxel [1]."""
    tail_moved: float
    """Share of the tail that is new [1]."""
    own_noise: Array
    """Covariance of the process noise of each taxel, as for `ForceErrorFilter.predict`, shape [taxels, own, own]."""
    cooled: Array
    """Share of its warmth that each taxel has lost [1]."""
    rate_noise: float
    """Variance that the rate of the chip temperature gains as the total force changes [K2/s2]."""
    leak: float
    """Rate of the leakage, relative to that of the calibration [1]."""
    leak_noise: float
    """Variance that the relative error of the leak rates gains [1]."""
    warming: float
    """Rate of the chip temperature that the touch is expected to cause [K/s]."""
    before: Belief
    """Belief before this block."""
    touch_before: TouchResponse
    """What touches have left until then."""
    unlikely: float = 0.0
    """Twice the negative logarithm of the likelihood of the reading, as zeros let expect it, up to a constant [1]."""


def _of_scans(name: str) -> Any:
    """Return a property that is an attribute of the compiled integration."""
    return property(
        lambda self: getattr(self.integration, name), lambda self, value: setattr(self.integration, name, value)
    )


class ForceEstimator:
    """Force of every taxel with its covariance, from charge densities; arrays row by row, shape [rows * cols].

    `integration` takes each scan; call `start` with the first one, and `close_block` whenever `block_time` has reached
    `BLOCK`. The force at the start is assumed to be zero: a taxel that is loaded then reads zero, a negative force once
    the load is released, and zero soon after.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    priors : ErrorPriors, optional
        How well everything is known; None: the defaults.
    calibration : Calibration, optional
        Properties of each taxel; None: nominal ones from the description.
    max_relative_uncertainty : float, default 0.2
        Standard deviation of the total force over that force, above which the forces are not valid [1]; while the force
        falls, over its greatest value of the last 0.16 s.
    """

    touch_at_start: bool = False
    """Whether forces are not valid until a release or a forced tare shows what no force is; may change."""
    _zero_known: bool = False
    _leaked_since: float = 0.0
    _farthest: float = 0.0
    lone_drifts: int = 0
    """Number of drifts of single taxels that were found."""

    def __init__(
        self,
        sensor: Sensor,
        priors: ErrorPriors | None = None,
        calibration: Calibration | None = None,
        max_relative_uncertainty: float = MAX_RELATIVE_UNCERTAINTY,
    ) -> None:
        taxels, device = sensor.layout.taxels, sensor.device
        calibration = calibration or Calibration.nominal(sensor)
        self._priors = p = (priors or ErrorPriors()).with_calibration(calibration)
        gain, noise = calibration.usable_gain, force_noise_rms(sensor)
        self._tau = calibration.leak_time_constant.copy()
        newton_per_kelvin = device.pyroelectric_coefficient / charge_per_newton(sensor)
        self._threshold = sensor.contact.threshold
        self._per_kelvin = newton_per_kelvin * calibration.pyroelectric_gain / gain
        self._per_kelvin[taxels * HOTTEST * np.abs(self._per_kelvin) < LEAST_DEVIATION * self._threshold] = 0.0
        self._mean_per_kelvin = float(self._per_kelvin.mean())
        self._noise_variance = np.full(taxels, noise**2)
        self._newton_per_charge = 1.0 / (charge_per_newton(sensor) * gain)
        whole = float(np.abs(self._per_kelvin).sum())
        self._negligible = LEAST_DEVIATION * self._threshold / whole if whole else math.inf
        self.max_relative_uncertainty = max_relative_uncertainty
        """Standard deviation of the total force over that force above which forces are not valid; may change."""
        self._runaway = RUNAWAY * device.force_max
        self.integration = self._integration = scan_path.ForceIntegration(
            self._tau,
            self._newton_per_charge,
            self._per_kelvin,
            LONG_STEP * float(self._tau.min()),
            greatest_loss=LEAST_DEVIATION * self._threshold,
            noticeable=NOTICEABLE * self._threshold,
            fastest=UniformChange.FASTEST,
            negligible=self._negligible,
            causes=COUNT + 5,
            leak_per_kelvin=calibration.leak_per_kelvin,
            leak_temperature=math.nan if calibration.temperature is None else calibration.temperature,
        )
        """What happens in every scan, and the state that it changes."""
        self._leak_per_kelvin_deviation = calibration.leak_per_kelvin_deviation
        lag = calibration.thermal_time_constant
        self._film_lag = max(device.thermal_time_constant if lag is None else lag, 0.0)
        self._dynamics = SharedDynamics(p, self._film_lag)
        self._gain = np.hypot(calibration.gain_deviation, p.gain_least)
        self._gain_common, self._leak = calibration.common_gain_deviation, calibration.leak_deviation
        self._filter = ForceErrorFilter(start_belief(taxels, start_mean(p), start_covariance(p)))
        self._touch = TouchResponse(sensor.layout, self._tau, self._per_kelvin, p)
        self._uniform = UniformChange(self._per_kelvin, p.pyroelectric)
        self._unexplained, self._release = UnexplainedResiduals(taxels, self._threshold), ReleaseDetector(taxels)
        self._jumps, self._lone_drift = JumpNoise(self._tau), LoneDrift(taxels)
        self._walk, self._steady_force = TemperatureWalk(p.film_walk, self._film_lag), SteadyForce()
        self._rest = RestDetector(taxels, noise, OFFSET_SPREAD * self._threshold, float(self._tau.max()))
        self._lower_bound = LowerBoundMonitor(taxels, self._threshold, NEGATIVE_TIME, LOST_FORCE_TIME)
        self._surroundings, self._held_forces = ContactSurroundings(sensor.layout), HeldForces(sensor.layout)
        warms = (taxels, p.warmth_time, self._threshold)
        self._thermal_contact, self._hidden_touch = ThermalContact(*warms), HiddenTouch(*warms)
        self._left = p.left_charge / sensor.volts_per_newton
        self._left_deviation = np.full(taxels, self._left)
        self.film: Thermometers = self._integration.thermometers
        """The chip's temperature sensors."""
        self.force = self._integration.force
        """Estimated force [N], positive when pushed; valid where `offset_known`. Owned by the estimator."""
        self.offset_known = self._integration.offset_known
        """Taxels whose offset is known."""
        self.ignored = self._integration.ignored
        """Faulty taxels, whose offsets `valid` does not depend on. Set by `ignore`."""
        self.restarts = 0
        """Number of restarts of taxels whose signal was consistent with no force."""
        self._make_state(taxels)
        self._start_block()

    def _make_state(self, taxels: int) -> None:
        self.informative = np.zeros(taxels, np.bool_)
        """Faulty taxels that still show a touch: sums of forces lack one that is listed nowhere. Set by the caller."""
        self._recovering, self._unread, self._last_duration = 0.0, 0.0, BLOCK
        self._refuted = 0.0
        self._refutation, self._witnesses = ZeroRefutation(), Witnesses()
        self._blocks: deque[Block] = deque(maxlen=LAG)
        self._hot = self._shown_hot = False  # whether this or the last touch has shown a hot film; the present one
        self._touches, self._begun, self._touched_for = False, False, 0.0
        self._usual_rate = self._greatest_touch = 0.0  # rate of the temperature before the touch; its greatest force
        self._recent_force: deque[float] = deque(maxlen=STILL_BLOCKS + RELEASED_BLOCKS)
        self._unobserved, self._leaked = 0, np.zeros(taxels)
        self._unheated_touch = self._touch  # what the touch leaves that there is without the hypothesis
        self._unheated: ForceErrorFilter | None = None  # the belief while the hypothesis is open, without it
        self._expected_film = self._expected_rate = 0.0  # without any change of the rate [K], [K/s]
        self._rested = 0.0  # time since a contact was listed [s]
        self._unconfirmed = 0.0  # temperature that this hypothesis claims beyond what the sensors show [K]
        scans = self._integration
        self._raw, self._change, self._correction, self._rate = scans.raw, scans.change, scans.correction, scans.rate
        self._sum, self._raw_sum, self._jumped = scans.sum, scans.raw_sum, scans.jumped
        self._lost = scans.lost  # deviation of what leaked in lost scans, common to all taxels [N]
        self._mean, self._last_mean, self._nothing = np.zeros((3, taxels))
        self._usual, self._touch_force, self._share, self._tail, self._warmed, self._warmth = np.zeros((6, taxels))
        self._own, self._untouched_variance, self._steady = np.zeros((3, taxels))
        self._untouched_time, self._usual_offset, self._stepped, self._hidden, self._felt = np.zeros((5, taxels))
        self._left_force = np.zeros(taxels)  # that left unseen, as the film had to recover from it then [N]
        self._unseen_for = 0.0  # time since then [s]
        self._tapped = np.zeros(taxels, np.bool_)
        self._factor = scans.correlated_error
        fastest = math.hypot(self._priors.creep_mean[0], self._priors.creep[0])
        scans.rise_deviation = math.hypot(self._gain_common, BRIEF * fastest)
        self._drift_response = np.zeros((taxels, COUNT))
        self._drift_response[:, Shared.DRIFT] = 1.0
        self._listed, self._touched, self._beside, self._below, self._nowhere = np.zeros((5, taxels), np.bool_)

    # What changes from scan to scan is held by the compiled path.
    valid: bool = _of_scans("valid")
    """Whether the forces of all taxels are valid."""
    _started: bool = _of_scans("started")
    _age: float = _of_scans("age")
    _scans: float = _of_scans("scans")
    _elapsed: float = _of_scans("elapsed")
    _square: float = _of_scans("square")
    _reading: float = _of_scans("reading")
    _sensors: float = _of_scans("sensors")

    @property
    def block_time(self) -> float:
        """Duration of the current block so far [s]."""
        return self._elapsed

    @property
    def block_mean(self) -> Array:
        """Mean of `force` over the block that is due [N], shape [rows * cols]."""
        return self._sum / self._scans

    @property
    def residual_charge(self) -> Array:
        """Charge at each gate, as the force that would generate it [N], shape [rows * cols]."""
        charge: Array = self._integration.signal - self._offset()
        return charge

    @property
    def change(self) -> Array:
        """Change of each force in the last step according to the signals [N], shape [rows * cols]."""
        return self._change

    @property
    def belief(self) -> Belief:
        """Means and covariance of the states."""
        return self._filter.belief

    @property
    def correlated_error(self) -> Array:
        """Factor E of the covariance E E' that the forces share [N], shape [rows * cols, causes]."""
        return self._factor

    def force_variance(self, out: Array) -> Array:
        """Return in `out` the variance of each force that it does not share with others [N2], shape [rows * cols]."""
        np.add(self._own, self._noise_variance, out=out)
        return out

    def variance(self, out: Array) -> Array:
        """Return in `out` the variance that each force would have without a touch [N2].

        It does not include what a touch itself makes uncertain: leaked charge, creep and warmth.

        Parameters
        ----------
        out : ndarray of float64, shape [rows * cols]
            Overwritten by the result.
        """
        np.add(self._untouched_variance, self._noise_variance, out=out)
        return out

    def steady_variance(self, out: Array) -> Array:
        """Return in `out` that variance without what steps have added in a touch, and with what warmth hides [N2].

        Neighbours that feel nothing contradict a signal that steps, too.

        Parameters
        ----------
        out : ndarray of float64, shape [rows * cols]
            Overwritten by the result.
        """
        self.variance(out)
        np.maximum(out - self._stepped, self._noise_variance, out=out)
        warmth = float(self.belief.shared[Shared.WARMTH])
        out += np.where(self._touched, 0.0, self._per_kelvin * warmth * (self._touch.warm + self._touch.range)) ** 2
        return out

    def ignore(self, taxels: Mask) -> None:
        """Set the faulty taxels, shape [rows * cols]; one that works again restarts with an unknown offset."""
        back = self.ignored & ~taxels
        self.ignored[:] = taxels
        if back.any():
            self._restart(back)

    def set_noise_variance(self, variance: Array) -> None:
        """Set the variance of a reading of each taxel [N2], shape [rows * cols]; initially that of the description."""
        self._noise_variance[:] = variance

    @property
    def age(self) -> float:
        """Time that has been processed [s]."""
        return self._age

    def interrupt(self) -> None:
        """Record that an unknown time passes before the next scan: changes of the force in it are unknown.

        Offsets stay known. At the next scan the force is set to the remaining charge, a lower bound of the force.
        """
        self._started = self.valid = False
        self._recovering = RESUME_TIME

    def tare(self, forced: bool = False) -> Array:
        """Set the forces to zero, and start a new block; offsets stay, as they are estimated all the time.

        Parameters
        ----------
        forced : bool, optional
            Whether forces may be applied: those of the newest scan are set to zero, and none remains a lower bound.
            Otherwise the mean forces of the last block are set to zero, which have less noise.

        Returns
        -------
        ndarray of float64, shape [rows * cols]
            Correction that was added to each force [N]; 0 for ignored taxels.
        """
        change: Array = np.where(self.ignored, 0.0, -self.force if forced else -self._mean)
        belief = self.belief
        belief.error[:, 0] -= change
        belief.own[:, 0, 0] += self._noise_variance
        self._correction -= change
        self.force += change
        self._integration.held[:] += change
        self._usual -= change
        self._mean = self._mean + change
        self._leaked = self._raw - self._integration.signal
        self._forget_blocks()
        self._drop_hypothesis()
        if forced:
            self._zero_known = True
            self._unexplained.reset()
            self._forget_touch()
            self._forget_contacts()
            self._integration.watch_none()
            self._integration.clipped[:] = 0.0
        self._start_block()
        return change

    def _forget_contacts(self) -> None:
        """Forget where something touches."""
        self._lower_bound.mask[:] = False
        self._refutation.wide = False
        self._listed = self._touched = self._beside = self._nowhere

    def _forget_touch(self) -> None:
        """Forget the touch, after which no force is zero, and what touches told: the force was another one.

        What it warmed cools.
        """
        belief, response, p = self.belief, self._touch.matrix(), self._priors
        self._hot = self._shown_hot = self._touches = self._begun = False
        self._touched_for, self._below = 0.0, self._nowhere
        self._hidden_touch.forget()
        self._thermal_contact.reset()
        left = np.zeros_like(response)
        left[:, Shared.FILM] = response[:, Shared.FILM]
        shown = belief.error[:, 0] + response @ belief.shared + self._touch.loops
        belief.reset_force_error(np.ones_like(self.ignored), shown, left, self._noise_variance)
        mean, prior = start_mean(p), start_covariance(p)
        for state in np.flatnonzero(OF_TOUCH).tolist():
            belief.restart(state, float(mean[state]), float(prior[state, state]))
        warm = [Shared.WARMTH, Shared.WEAK_WARMTH]
        belief.slope[:, 4, warm] = response[:, warm]
        belief.error[:, 4] += response[:, warm] @ mean[warm]
        self._touch.reset()

    def close_block(self, touched: Mask, contacts: Sequence[NDArray[np.intp]] = ()) -> None:
        """Process the block that is due.

        Parameters
        ----------
        touched : ndarray of bool, shape [rows * cols]
            Taxels in contact at any time of the block. Has no effect where the offset is unknown: there a constant
            force is as informative as no force.
        contacts : sequence of ndarray of int
            Taxels of each contact.
        """
        try:
            self._estimate(touched, contacts)
        except ValueError:  # the covariance of the filter is none
            self._start_over()

    def forget(self) -> None:
        """Forget all, as if the next scan were the first one: what was known is wrong."""
        self._farthest = self._touched_for = self._rested = 0.0
        self._left_force[:] = self._touch_force[:] = self._tail[:] = self._warmth[:] = 0.0
        self._warmed[:] = self._stepped[:] = 0.0
        self._left_deviation[:] = self._left
        self._unexplained = UnexplainedResiduals(len(self.force), self._threshold)
        self._hot = self._shown_hot = self._touches = self._begun = self._zero_known = False
        self._below = self._nowhere
        self._hidden_touch.forget()
        taxels, p = len(self.force), self._priors
        self._filter.belief = start_belief(taxels, start_mean(p), start_covariance(p))
        self._touch.reset()
        self._forget_contacts()
        self.offset_known[:] = False
        self.force[:] = 0.0
        self._started = self.valid = False

    def _start_over(self) -> None:
        """Forget all that the filter believes: what it says is impossible."""
        self.restarts += int(np.count_nonzero(~self.ignored))
        self.forget()
        self.start(self._integration.signal / self._newton_per_charge)

    def _estimate(self, touched: Mask, contacts: Sequence[NDArray[np.intp]]) -> None:
        """Process the block that is due; raise ValueError where the belief is none that can be."""
        listed = touched & self.offset_known
        if any_true(lost := self._unreleased(listed)):
            alone = lost & ~self._surroundings.dilated(listed)
            listed = listed | lost
            contacts = (*contacts, alone.nonzero()[0]) if any_true(alone) else contacts
        touched = self._find_touched(listed)
        block = self._measure(touched, listed)
        self._follow_touch(block)
        begun = touched & ~self._touched
        if any_true(self._listed):
            begun &= ~self._beside  # where forces were small ones, and no zeros
        self._observe_rest(block)
        self._blocks.append(block)
        if self._unheated is not None:
            self._follow_unheated(block)
        self._process(block, any_true(begun))
        self._listed = listed
        self._observe_steady_force()
        self._observe_lone_drift(block)
        variance = self._own + self._shared_variance()
        bends = slice(Shared.BEND, Shared.BEND + BENDS)
        predicted = self._filter.predicted(block.response)
        course = block.mean - predicted + block.response[:, bends] @ self.belief.shared[bends]
        rise = block.mean - self._blocks[-1 - STILL_BLOCKS].mean if len(self._blocks) > STILL_BLOCKS else self._nothing
        released = self._release.update(
            contacts, self._mean, course, rise, self._touched, variance, block.noise, block.duration
        )
        left = self._thermal_contact.find_left(contacts)
        if released is None and any_true(left):
            released = np.zeros_like(left)
        if released is not None:
            left &= ~released
            released |= left
            # Beside a noisy taxel that still shows a force, nothing was released.
            least = np.maximum(self._threshold, GATE * np.sqrt(variance))
            shown = self.ignored & self.informative & (self._mean > least)
            released &= ~self._surroundings.dilated(shown)
        if released is not None and any_true(released):
            self.belief.own[:, 0, 0] += np.where(released, self._absorbed() ** 2, 0.0)
            self._touch.reduce_warmth(released, self._mean, float(self.belief.shared[Shared.WARMTH]))
            block.response[:] = self._touch.matrix()
            self._set_zero(released & ~left, released & left, block)
        if any_true(self._lower_bound.mask):
            self._end_unknown_touch(block)
        self._touched = block.touched
        self._beside = self._surroundings.dilated(block.touched)
        if not abs(self.belief.shared[Shared.FILM]) < HOTTEST:
            raise ValueError("no film survives this temperature")
        self._finish(block)

    def _process(self, block: Block, begun: bool) -> None:
        """Process the newest block, or the stored ones again where a touch has `begun`, or zeros are refuted."""
        self._refuted = 0.0
        usable = self.offset_known & ~self.ignored
        if begun:
            self._process_again(block.touched)
        else:
            self._step(block)
            if self._refuted and self._blocks:
                block.touched = block.touched | usable
                self._process_again(block.touched)
        self._follow_witnesses(block)
        if self._take_witness():
            block.touched = block.touched | usable
            self._mean = block.mean - self._filter.predicted(block.response)

    def _find_touched(self, listed: Mask) -> Mask:
        """Return the taxels whose force is not known to be none or small.

        Those in contact, those that a touch may have begun on, and those that were touched and have not been still
        since.
        """
        # Those touched since before an interruption have a force that is unknown: not none, whatever the signal says.
        suspected = self._lower_bound.mask
        if not any_true(listed):
            # A wide object presses more taxels than those whose residual is beyond its noise.
            suspected = suspected | self._unexplained.rising
        unknown = self._unexplained.rising | self._surroundings.dilated(suspected)
        hot = self._may_be_hot()
        if hot:  # below zero no object touches, else
            self._below = (self._sum / self._scans < -self._threshold) & self._may_be_warm()
            unknown |= self._below
        else:
            self._below = self._nowhere
        self._hidden_touch.follow_readings(self._sum / self._scans, self._film_hides(self.belief))
        unknown |= self._hidden_touch.pressed
        if self._refutation.wide:
            unknown |= True
        if any_true(self._touched):
            noise, mean = np.sqrt(self._noise_variance / self._scans), self._sum / self._scans
            left = self._release.left(np.abs(mean) if hot else mean, noise)
            usable = ~self.ignored
            if self._refutation.significant and self._is_whole(self._touched) and any_true(usable):
                # What presses all taxels slowly is still, and has not left.
                left &= mean <= PRESSED * mean[usable].mean()
            unknown |= self._touched & ~left
        touched: Mask = listed | (unknown & self.offset_known)
        return touched

    def _is_whole(self, touched: Mask) -> bool:
        """Return whether a touch leaves too few taxels to show the film's temperature."""
        return int(np.count_nonzero(~(self.ignored | touched))) < UniformChange.FEWEST

    def _unreleased(self, listed: Mask) -> Mask:
        """Return the taxels of contacts that became uncertain, and were not released.

        That a contact is no longer significant is no evidence of zero forces. Of a contact with the whole array, where
        no untouched taxel shows the film's temperature, single taxels become uncertain, too.
        """
        usable = ~self.ignored
        beside = self._surroundings.dilated(listed)
        was = self._touched if self._is_whole(self._touched) else self._listed & ~beside
        return usable & was & ~listed & self.offset_known & (self._sum > self._scans * self._threshold)

    def _has_rested(self, longer: float = 0.0) -> bool:
        """Return whether the last contact ended before the stored blocks, and so long before them [s]."""
        lasted = sum(each.duration for each in self._blocks)
        return self._rested >= LAG * BLOCK + longer and self._rested + 0.5 * BLOCK >= lasted + longer

    def _observe_rest(self, block: Block) -> None:
        """Observe the noise of the oldest blocks, unless a touch may have begun in them, or has just ended."""
        self._rested = 0.0 if any_true(block.listed) else self._rested + self._elapsed
        at_rest = len(self._blocks) == LAG and self._has_rested(QUIET)
        self._observe_steps(at_rest)
        usable = ~self.ignored
        comparable = np.count_nonzero(usable) >= UniformChange.FEWEST and self._uniform.observable
        if not at_rest or not comparable or any_true(block.touched):
            self._walk.pause()
            return
        before, after = self._blocks[0], self._blocks[1]
        change = after.mean - before.mean - after.span * self._offset() * self._per_second()
        # What all have in common is the film's temperature.
        kelvin = upper_median((change / self._per_kelvin)[usable])
        single = float((after.noise / (self._per_kelvin * self._per_kelvin))[usable].mean())
        noise = 0.5 * math.pi * single / np.count_nonzero(usable)  # that of a median
        known = self._walk.intensity
        self._walk.observe(kelvin, noise, after.span)
        if (grown := self._walk.intensity - known) > 0.0:
            # A walk that was not expected counted as a drift of the offsets, as far as it can look like one. The film
            # warmed by less then, since the start, and zeros were the same.
            drifting = np.zeros(COUNT)
            drifting[Shared.DRIFT] = 1.0
            drifting[Shared.RATE] = -1.0 / self._mean_per_kelvin
            drifting[[Shared.CHIP, Shared.FILM, Shared.SENSOR]] = self._age * drifting[Shared.RATE]
            observed = min(self._age, MEMORY * LEAST_TIME)
            self._filter.widen(drifting, (self._mean_per_kelvin / self._age) ** 2 * grown * observed)
        self._dynamics.set_film_walk(self._walk.intensity)

    def _observe_steps(self, at_rest: bool) -> None:
        """Observe the steps of single signals in the middle of the stored blocks.

        At rest also those that are no rises of the force, whatever they are.
        """
        if len(self._blocks) < LAG:
            return
        usable, blocks = ~self.ignored, tuple(self._blocks)[: 2 * HALF + 1]
        before, after, later = blocks[HALF - 1 : HALF + 2]
        force, step = np.array([block.mean for block in blocks])[:, usable], np.zeros(len(usable))
        time = np.cumsum([block.span for block in blocks])
        step[usable] = signal_steps(time, force, after.noise[usable], self._tau[usable])
        change = self._nothing
        if at_rest and np.count_nonzero(usable) >= UniformChange.FEWEST and self._uniform.observable:
            drift = self._offset() * self._per_second()
            change = later.mean - before.mean - (after.span + later.span) * drift
            change -= self._per_kelvin * upper_median((change / self._per_kelvin)[usable])
        self._jumps.observe(usable, step, change, after.noise, after.span)

    def _observe_steady_force(self) -> None:
        """Update the shared states by a force that has been steady in all stored blocks."""
        self._unobserved += 1
        if len(self._blocks) < LAG or self._unobserved < HOP or not any_true(self._blocks[-1].listed):
            return
        self._unobserved = 0
        blocks = tuple(self._blocks)
        held = np.logical_and.reduce([block.listed for block in blocks]) & ~self.ignored & ~self._lower_bound.mask
        if not any_true(held):
            return
        belief = self.belief
        kelvin = abs(float(self._per_kelvin[held].sum()))
        film = [float(block.before.shared[Shared.FILM]) for block in blocks]
        rate = math.sqrt(belief.covariance[Shared.RATE, Shared.RATE])
        time = np.cumsum([block.span for block in blocks])
        response = np.array([block.response[held] for block in blocks])
        charge = np.array([block.charge[held] for block in blocks])
        response[:, :, Shared.LEAK] = -charge  # as it is, whatever its time constant
        force = np.array([block.mean[held] for block in blocks]) - self.belief.error[held, 0] - response @ belief.shared
        response[:, :, Shared.FILM] = 0.0  # the only one of these states that is not constant
        found = self._steady_force.observe(
            time,
            force,
            charge,
            response.sum(axis=1),
            kelvin * (max(film) - min(film) + rate * float(time[-1] - time[0])),
            float(blocks[-1].noise[held].sum()),
        )
        if found is None:
            return
        expected = float(found.sensitivity @ belief.covariance @ found.sensitivity) + found.variance
        if found.innovation**2 < SURPRISING**2 * expected:
            self._filter.measure_shared(found.innovation, found.sensitivity, found.variance)

    def _observe_lone_drift(self, block: Block) -> None:
        """Find a taxel whose force drifts alone: its signal has stepped, since it was last known to be still."""
        if self._hidden_share > HIDES:
            self._lone_drift.restart()
            return
        counts = self.offset_known & ~self.ignored & ~self._lower_bound.mask
        noise = float(block.noise.max(where=counts, initial=0.0))
        found = self._lone_drift.observe(self._mean, counts, block.listed, block.touched, noise, block.span)
        if found is None:
            return
        step = np.zeros(len(self._mean))
        step[found.taxel] = found.rate / self._per_second()[found.taxel]
        self.belief.error[found.taxel, 1] += step[found.taxel]
        self.belief.error[found.taxel, 0] += step[found.taxel] + 0.5 * (found.earliest + found.latest) * found.rate
        self.belief.own[found.taxel, 0, 0] += ((found.earliest - found.latest) * found.rate) ** 2 / 12.0
        self._jumps.admit(step)
        self.lone_drifts += 1
        self._forget_blocks()

    @property
    def _reading_interval(self) -> float:
        """Interval at which new readings of the temperature come [s]."""
        return STATUS_INTERVAL if math.isnan(self.film.interval) else float(self.film.interval)

    def _unknown_warmth(self, touched: Mask) -> Array:
        """Return the covariance of the warmth that no response knows, of taxels that count as untouched from now on.

        On a hot film they do so once it is no more than a contact threshold.
        """
        unknown = np.zeros_like(self.belief.own)
        if self._may_be_hot():
            cools = self._touched & ~touched
            for row, column in ((0, 0), (0, 4), (4, 0), (4, 4)):
                unknown[cools, row, column] = self._threshold**2
        return unknown

    def _measure(self, touched: Mask, listed: Mask) -> Block:
        """Return the block that is due."""
        mean = self._mean = self._sum / self._scans
        leaked = self._raw - self._integration.signal
        # What leaks in a block is its mean charge.
        charge = (leaked - self._leaked) / (self._per_second() * self._elapsed)
        self._leaked = leaked
        self._unread += self._elapsed
        self._leaked_since += self._elapsed * self._integration.leak
        repeated = math.isnan(self._reading) and self._unread >= REPEATED * self._reading_interval and self.film.known
        if repeated:
            self._reading = self._sensors
        any_touched = any_true(touched)
        # Noise is no motion: without this play its path would count, which is long after a minute.
        play = PLAY * np.sqrt(self._noise_variance / self._scans)
        self._steady = np.minimum(np.maximum(self._steady, mean - play), mean + play)
        neighbour = tail = self._nothing
        if any_touched:
            least = 0.1 * self._threshold
            felt = self._surroundings.completed(np.where(self.ignored, math.nan, np.abs(self._steady)), least)
            neighbour = self._surroundings.greatest_neighbour(felt)
            tail = np.where(touched, 0.0, self._surroundings.geometric_decline(felt, least))
        touch_before = deepcopy(self._touch)
        self._advance_touch(listed, tail)
        response, p = self._touch.matrix(), self._priors
        held = np.where(touched, np.maximum(self._steady, 0.0), 0.0)
        warmed, warmth = self._warmth_variance(), self._touch.warm + self._touch.range
        span = 0.5 * (self._last_duration + self._elapsed)
        own_noise = self._unknown_warmth(touched)
        own_noise[:, :2, :2] += p.offset_walk**2 * span
        grown = own_noise[:, 0, 0]
        grown += self._noise_variance * (self._square * self._per_second() ** 2)
        grown += self._jumped + self._step_noise(touched, span) + self._clipped_noise() + self._recovery_noise(span)
        left = np.divide(warmth, self._warmth, out=np.zeros_like(warmth), where=self._warmth > 0.0)
        cooled = np.minimum(np.maximum(1.0 - left, 0.0), -math.expm1(-span / p.warmth_time))
        differs = np.maximum(warmed, self._warmed) - (1.0 - cooled) ** 2 * self._warmed
        grown += differs
        own_noise[:, [0, 4, 4], [4, 0, 4]] += differs[:, None]
        tail_moved, moved = 0.0, self._moved_share(held)
        if any_touched or self._touch.responding or any_true(self._touched):
            spread = self._tail_spread(self.belief)
            grown += p.motion**2 * np.abs(held - self._touch_force) * np.maximum(held, self._touch_force)
            own_noise[:, 2, 2] = spread**2 * np.abs(tail - self._tail) * np.maximum(tail, self._tail)
            own_noise[:, 2, 2] += np.maximum(warmed - self._warmed, 0.0)
            own_noise[:, 2, 2] += np.where(self._surroundings.dilated(touched), moved * tail**2, 0.0)
            whole = float(np.maximum(tail, self._tail).sum())
            tail_moved = float(np.abs(tail - self._tail).sum()) / whole if whole else 0.0
        total, before = float(held.sum()), float(self._touch_force.sum())
        self._touch_force, self._tail, self._warmed, self._warmth = held, tail, warmed, warmth
        block = Block(
            self._raw_sum / self._scans - self._touch.loops,
            self._noise_variance / self._scans,
            self._elapsed,
            charge,
            span,
            self._reading,
            self._priors.reading**2 * (max(SAME_ERROR / self._unread, 1.0) if repeated else 1.0),
            min(self._unread, self._reading_interval),  # a reading that shows no change is none
            self._leaked_since,
            listed,
            touched,
            response,
            neighbour,
            tail,
            moved,
            tail_moved,
            own_noise,
            cooled,
            self._rate_noise(before, total, touch_before.warming),
            self._integration.leak,
            self._leak_noise(),
            self._touch.warming,
            self.belief.copy(),
            touch_before,
        )
        self._last_duration = self._elapsed
        if not math.isnan(self._reading):
            self._reading, self._unread = math.nan, 0.0
        return block

    def _clipped_noise(self) -> Array:
        """Return the variances of what leaked unseen of clipped signals [N2]: it adds to what is wrong already."""
        clipped, wrong = self._integration.clipped, np.maximum(self.belief.own[:, 0, 0], 0.0)
        noise: Array = (np.sqrt(wrong) + clipped) ** 2 - wrong
        clipped[:] = 0.0
        return noise

    def _recovery_noise(self, span: float) -> Array:
        """Return by what variance forces may recover in a time from those that left unseen [N2]."""
        p = self._priors
        self._unseen_for += span
        creep = self._recovery_left * sum(math.hypot(*each) for each in zip(p.creep_mean, p.creep, strict=True))
        return np.asarray((creep * self._left_force) ** 2 * (span / RECOVERING))

    @property
    def _recovery_left(self) -> float:
        """Share of the recovery from what left unseen that is left [1]."""
        return math.exp(-self._unseen_for / self._priors.creep_times[-1])

    def _rate_noise(self, before: float, total: float, warmed_by: float) -> float:
        """Return the variance that the rate of the chip temperature gains as the total force changes [K2/s2]."""
        warming = self._touch.warming
        by_force = self._priors.touch_rate**2 + self._heating(before, total) ** 2
        expected = self._priors.warming_share**2 * abs(warming - warmed_by) * max(abs(warming), abs(warmed_by))
        return by_force * abs(total - before) * max(total, before) + expected

    def _heating(self, before: float, total: float) -> float:
        """Return by how much the rate of the temperature may change as the force falls [K/s/N]."""
        belief = self.belief
        rate = float(belief.shared[Shared.RATE])
        if before <= 0.0:
            self._usual_rate = float((self._blocks[0].before if self._blocks else belief).shared[Shared.RATE])
            self._greatest_touch = 0.0
        self._greatest_touch = max(self._greatest_touch, total)
        if total >= before:
            return 0.0
        deviation = math.sqrt(belief.covariance[Shared.RATE, Shared.RATE])
        return max(abs(rate - self._usual_rate) - GATE * deviation, 0.0) / self._greatest_touch

    def _leak_noise(self) -> float:
        """Return the variance that the leak rates gain as far from the calibration's temperature as never before."""
        warmer, before = abs(self._integration.warmer), self._farthest
        self._farthest = before if math.isnan(warmer) else max(before, warmer)
        return float(self._leak_per_kelvin_deviation**2 * (self._farthest**2 - before**2))

    def _moved_share(self, held: Array) -> float:
        """Return the share of the force that has moved from taxel to taxel within a block."""
        total, before = float(held.sum()), self._share
        share = held / total if total else held
        deviation = np.sqrt(self._own + self._shared_variance()) / total if total > 0.0 else 0.0
        play = np.minimum(np.maximum(deviation, SHARE_PLAY), GREATEST_SHARE_PLAY)
        self._share = np.minimum(np.maximum(before, share - play), share + play)
        if not total or before.sum() <= BEGUN:
            return 0.0
        return 0.5 * float(np.abs(self._share - before).sum())

    def _advance_touch(self, listed: Mask, tail: Array) -> None:
        """Advance the responses to the touch."""
        force = least = most = self._nothing
        shared = self.belief.shared
        if any_true(listed):
            around = self._surroundings.dilated(listed)
            counted = ~self.ignored | self.informative
            force = np.where(around & counted, np.maximum(self._steady, 0.0), 0.0)
            # Without the force that is the warmth's own, which would keep itself up.
            by_warmth = self._per_kelvin * float(shared[Shared.WARMTH]) * self._touch.warm
            tail = np.where(around, tail, 0.0)
            least = np.maximum(force + np.minimum(by_warmth, 0.0), self._priors.tail * tail)
            most = np.maximum(force, 2.0 * self._tail_spread(self.belief) * tail)
        self._follow_thermal_contact()
        # Where warmth might be all of a force, it is what it was when that beside it came to rest.
        if self._priors.warmth_certain > 0.0:
            certain = ~self.ignored & (least > self._threshold)
            self._held_forces.update(np.where(self.ignored, 0.0, force), certain, self._elapsed)
            if any_true(listed):
                least = np.where(around & ~certain, np.maximum(least, self._held_forces.held), least)
            if any_true(listed):
                warmed = around & self._thermal_contact.warmed
                least, most = np.where(warmed, math.inf, least), np.where(warmed, math.inf, most)
        slower = max(1.0 + float(shared[Shared.LEAK]), LEAST_LEAK) / self._integration.leak - 1.0
        self._touch.advance(force, least, most, self._elapsed, slower, float(shared[Shared.WARMTH]))

    @property
    def _hidden_share(self) -> float:
        """What warmth hides of a force, over the force that causes most of that warmth [1]."""
        return self._hidden_share_of(self.belief)

    def _hidden_share_of(self, belief: Belief) -> float:
        hidden = -self._mean_per_kelvin * float(belief.shared[Shared.WARMTH])
        return hidden / max(self._priors.warmth_force, self._threshold)

    def _follow_thermal_contact(self) -> None:
        """Follow what the taxels read but for their warmth, where that may be all of a force."""
        warmth, weak = self.belief.shared[[Shared.WARMTH, Shared.WEAK_WARMTH]].tolist()
        if self._hidden_share <= 1.0:
            self._thermal_contact.reset()
            return
        warmed = warmth * self._touch.warm + weak * self._touch.range
        reading = np.where(self.ignored, 0.0, self._mean + self._per_kelvin * warmed)
        self._thermal_contact.update(reading, self._elapsed)

    def _tail_spread(self, belief: Belief) -> float:
        """Return by how much forces beside a contact differ from what they have in common, relative to the decline.

        As much as that itself, which is far from its prior where forces do not decline geometrically: beside a pad.
        """
        return max(self._priors.tail, abs(float(belief.shared[Shared.TAIL])))

    def _offset(self) -> Array:
        """Return the offset of each signal [N], with what all have in common."""
        offset: Array = self.belief.error[:, 1] + self._tau * self.belief.shared[Shared.DRIFT]
        return offset

    def _integrated(self, time: float | Array) -> tuple[Array, Array]:
        """Return what the offsets and the common drift add to the force errors in a time [s], as for `integrate`."""
        drifting = np.multiply(self._drift_response.T, time * self._integration.leak).T
        return time * self._per_second(), drifting

    def _per_second(self) -> Array:
        """Return the leak rates at the present temperature [1/s]."""
        rate: Array = self._integration.leak / self._tau
        return rate

    def _was_misled(self) -> bool:
        """Return whether the rate of the temperature has changed since the oldest stored block unexpectedly.

        That is, by more than its dynamics let expect, as the forces rose: zeros of what a wide object presses do that,
        each by too little to be noticed.
        """
        if not self._blocks:
            return False
        before = self._blocks[0].before
        change = float(self.belief.shared[Shared.RATE] - before.shared[Shared.RATE])
        noise = self._dynamics.transition(before.shared, self._blocks[-1].span)[2][Shared.RATE, Shared.RATE]
        variance = before.covariance[Shared.RATE, Shared.RATE] + len(self._blocks) * noise
        return change * self._mean_per_kelvin > 0.0 and change * change > SURPRISING * SURPRISING * float(variance)

    def _process_again(self, touched: Mask) -> None:
        """Process the stored blocks again without the taxels that a touch, it turned out, had begun on.

        Those that do not show it themselves are left out of the last blocks only: their zeros before that tell their
        offsets. All are left out where a wide object began.
        """
        wide = self.offset_known & (self._refuted != 0.0 or self._was_misled())
        self._filter.belief = self._blocks[0].before
        if self._refuted:
            self._witnesses.clear()
            lasted = sum(each.duration for each in self._blocks)
            direction = self._dynamics.maneuver(self.belief.shared, max(LAG * BLOCK, lasted))
            self._filter.admit(direction, (self._refuted / direction[Shared.FILM]) ** 2)
        blocks = tuple(self._blocks)  # the newest one may restart taxels, which forgets them
        shown = touched & (blocks[-1].listed | self._unexplained.rising)
        for index, block in enumerate(blocks):
            block.before = self.belief.copy()
            block.touched = block.touched | (touched if index >= len(blocks) - SUSPECTED else shown) | wide
            self._step(block)
        self._mean = block.mean - self._filter.predicted(block.response)

    def _step(self, block: Block) -> None:
        """Propagate the belief over a block, and update it by the temperature and by the forces that are known."""
        beside = self._predict(self._filter, block)
        own = self.belief.own[:, 1, 1]
        np.maximum(own, self._jumps.least_offset_variance(), out=own)
        zeros = ~block.touched & ~self.ignored & (self._unexplained.below == 0.0)
        kelvin, deviations, square, spread = self._measure_temperature(self._filter, block, any_true(zeros))
        hidden = any_true(zeros) and kelvin * self._mean_per_kelvin < 0.0 and not self._uniform.open
        hidden = hidden and self._has_rested()  # a release moves the rate, too
        self._refuted = kelvin if hidden and deviations > SIGNIFICANT and self._was_misled() else 0.0
        if self._refuted:
            self._refutation.refute()
        block.unlikely = min(square, SURPRISING * SURPRISING) + spread
        self._measure_zeros(block, beside)

    def _may_tell(self) -> bool:
        """Return whether readings of the sensors may tell a press from a film that cools."""
        known = (self.offset_known | self.ignored).all()
        return bool(self._priors.slow_rate > 0.0 and self._rested >= SPACING and known)

    def _follow_witnesses(self, block: Block) -> None:
        """Let the witnesses follow a block."""
        if not self._may_tell():
            self._witnesses.clear()
            return
        self._witnesses.add(block)
        if (behind := self._witnesses.behind()) is not None:
            witness, passage = behind
            self._predict(witness.filter, passage)
            square, spread = self._measure_temperature(witness.filter, passage, False)[2:]
            witness.evidence += passage.unlikely - (square + spread)
            if square > SURPRISING * SURPRISING:
                self._witnesses.clear()  # the temperature does something of its own

    def _take_witness(self) -> bool:
        """Believe the witness with the most evidence, if that is enough, and if zeros have hidden a press since then.

        Not while the hypothesis of a warmer film is open, which has a witness of its own. Otherwise a new witness is
        called when it is time.
        """
        film = self.belief.shared[Shared.FILM]
        found = [
            each
            for each in self._witnesses.all
            if (film - each.filter.belief.shared[Shared.FILM]) * self._mean_per_kelvin > 0.0
            and each.evidence > EVIDENCE
            and not self._uniform.open
        ]
        if not found:
            if self._may_tell():
                self._witnesses.call(self.belief)
            return False
        best = max(found, key=lambda each: each.evidence)
        self._filter.belief = best.before
        for passage in self._witnesses.passages(best):
            self._predict(self._filter, passage)
            self._measure_temperature(self._filter, passage, False)
        self._refutation.refute()
        self._forget_blocks()
        return True

    def _forget_blocks(self) -> None:
        """Forget what could be processed again, as that would undo what has been decided."""
        self._blocks.clear()
        self._witnesses.clear()
        self._lone_drift.restart()

    def _measure_temperature(self, f: ForceErrorFilter, block: Block, zeros: bool) -> tuple[float, float, float, float]:
        """Update a belief by a new reading of the temperature sensors; return its difference from the expected one [K].

        Also the size of that in its deviations [1]; and its square in its variance, before anything explains it, with
        the logarithm of that variance [1].

        An unexpected one shows that the rate changed, at least as if the sensors had no lag. While zero forces
        determine the temperature of the film, it may have warmed since before the start; soon after that, and not
        where something touches, which warms it, too. If neither explains it, it shows only that the sensors differ
        from their model, and is weighted down.
        """
        if math.isnan(block.reading):
            return 0.0, 0.0, 0.0, 0.0
        variance = block.reading_variance
        innovation, _, total = f.temperature_innovation(block.reading, variance, block.leaked_time)
        surprising = innovation * innovation > SURPRISING * SURPRISING * total
        unlikely = innovation * innovation / total, math.log(total)
        if surprising and not zeros:
            rate = min(abs(innovation) / block.interval, self._priors.fastest)
            f.admit(self._dynamics.maneuver(f.belief.shared, block.interval), rate * rate)
            innovation, _, total = f.temperature_innovation(block.reading, variance, block.leaked_time)
            surprising = innovation * innovation > SURPRISING * SURPRISING * total
        early = block.leaked_time < EARLY and not any_true(block.touched)
        if surprising and zeros and self._uniform.observable and early:
            direction = np.eye(COUNT)[Shared.EARLIER]
            # Half of what was missed until now has counted as an error of the zero.
            direction[Shared.ZERO] = -0.5 * block.leaked_time
            f.admit(direction, min(2.0 * abs(innovation) / block.leaked_time, self._priors.rate) ** 2)
            innovation, _, total = f.temperature_innovation(block.reading, variance, block.leaked_time)
            surprising = innovation * innovation > SURPRISING * SURPRISING * total
        found = innovation, abs(innovation) / math.sqrt(total), *unlikely
        if surprising:
            variance += (innovation / SURPRISING) ** 2
        # The sensors' lag is exponential in its state: a step beyond the range of linearisation is made in parts.
        _, column, total = f.temperature_innovation(block.reading, variance, block.leaked_time)
        variance += max(abs(innovation * float(column[Shared.LAG])) / LARGEST_LAG_STEP - total, 0.0)
        f.measure_temperature(block.reading, variance, block.leaked_time)
        return found

    def _predict(self, errors: ForceErrorFilter, block: Block) -> Mask:
        """Propagate a belief over a block; return the taxels beside a contact."""
        p, belief = self._priors, errors.belief
        beside: Mask = ~block.touched & (block.neighbour > 0.0)
        belief.forget_small_forces(~beside)
        own_noise = block.own_noise.copy()
        fresh = beside & (belief.own[:, 2, 2] == 0.0)
        if any_true(fresh):
            small = self._tail_spread(belief) * block.tail + p.tail_least * block.neighbour
            own_noise[fresh, 2, 2] = (small * small)[fresh]
        after, matrix, noise = self._dynamics.transition(belief.shared, block.span, block.warming)
        # As the forces beside the contact change, the tail does by as much as it is.
        forgotten = block.moved_share + 0.5 * self._tail_spread(belief) ** 2 / UNKNOWN_TAIL * block.tail_moved
        kept = math.exp(-forgotten)
        matrix[Shared.TAIL, Shared.TAIL] = kept
        after[Shared.TAIL] = p.tail + kept * (belief.shared[Shared.TAIL] - p.tail)
        noise[Shared.TAIL, Shared.TAIL] = (1.0 - kept**2) * UNKNOWN_TAIL
        noise[Shared.RATE, Shared.RATE] += block.rate_noise
        noise[Shared.LEAK, Shared.LEAK] += block.leak_noise
        belief.respond(self._per_kelvin * float(after[Shared.FILM] - belief.shared[Shared.FILM]))
        belief.cool(block.cooled)
        leaked = block.leak / self._tau
        drifting = block.leak * self._drift_response
        errors.predict(after, matrix, noise, block.span * leaked, block.span * drifting, own_noise)
        return beside

    def _measure_zeros(self, block: Block, beside: Mask) -> None:
        """Update by the forces that are known to be zero or small."""
        judged = (~block.listed | ~self.offset_known) & ~self.ignored
        where = (~block.touched | ~self.offset_known) & ~self.ignored
        p, f = self._priors, self._filter
        response, measured, some_beside = block.response, block.mean, any_true(beside)
        noise = block.noise.copy()
        if some_beside:
            # What the shared states predict of the small force stays subtracted, as it is from the force.
            measured = measured - np.where(beside, (response * OF_TOUCH) @ f.belief.shared, 0.0)
            response = np.where(beside[:, None], response * ~OF_TOUCH, response)
            response[:, Shared.TAIL] = np.where(beside, block.tail, 0.0)
            changed = self._warmth_variance() + TAIL_NOISE + (p.tail_change * block.neighbour) ** 2
            noise += np.where(beside, changed, 0.0)
        unseen = (self._left_force > 0.0) & ~self.ignored & (self._unseen_for < COOLED * p.warmth_time)
        residual, sensitivity, deviation = f.innovation(measured, response, noise)
        if self._admit_warmer_object(where & ~unseen, residual, sensitivity, noise):
            residual, sensitivity, deviation = f.innovation(measured, response, noise)
        odd = np.abs(residual) > GATE * deviation
        listed = any_true(block.listed)
        if listed or not any_true(block.touched):
            own = self._own_deviation(noise)
            # While a contact grows, the rest of a wide object rises like a warmer film.
            telling = where if listed else judged
            kelvin = self._uniform.temperature(
                residual, telling, deviation, own, block.duration, not listed and any_true(odd & where)
            )
            if kelvin:
                known = bool((self.offset_known | self.ignored).all())
                if kelvin * self._mean_per_kelvin > 0.0 and not listed and known:
                    self._open_hypothesis()
                direction = self._dynamics.maneuver(f.belief.shared, block.duration)
                f.admit(direction, (kelvin / direction[Shared.FILM]) ** 2)
                noise = noise + (p.pyroelectric * kelvin * self._per_kelvin) ** 2
                residual, sensitivity, deviation = f.innovation(measured, response, noise)
                own = self._own_deviation(noise)
                odd = np.abs(residual - kelvin * self._per_kelvin) > GATE * own
        # Of a release, some blocks look like a film that cools.
        odd |= (self._unexplained.below > 0.0) & (residual < -self._threshold)
        if any_true(zeros := where & ~odd & ~unseen):
            f.update(zeros, residual, sensitivity, noise)
        faulty = self.ignored & self.offset_known & ~block.listed
        # A noisy taxel still counts in a contact, and so must be zero before it.
        if any_true(alone := (faulty | unseen) & ~block.touched & ~odd):
            f.update_alone(alone, f.innovation(measured, response, noise)[0], sensitivity, noise)
        if block is self._blocks[-1]:
            watched = judged | faulty
            # What most taxels share is no touch of a single one.
            updated = ~block.touched & ~odd
            # Responses differ, and leak as time constants do: by the rate before a touch that may have changed it.
            warming = p.pyroelectric * float(self._blocks[0].before.shared[Shared.RATE]) * block.duration
            unmodelled = (self._per_kelvin * warming) ** 2
            odd |= self._unexplained.persistent(
                watched & ~block.touched & self.offset_known,
                f.post_fit(updated, measured, response, noise, unmodelled),
            )
            self._judge(block, watched & odd, judged, residual)

    def _admit_warmer_object(self, zeros: Mask, residual: Array, sensitivity: Array, noise: Array) -> bool:
        """Widen the common warmth where zeros show a film that is warmer than believed; return whether they do."""
        warm = zeros & (np.abs(sensitivity[:, Shared.WARMTH]) > WARMED * np.abs(self._per_kelvin))
        if not any_true(warm):
            return False
        weight = sensitivity[warm, Shared.WARMTH] / self._own_deviation(noise)[warm] ** 2
        of_sum = weight @ sensitivity[warm]
        information = float(of_sum[Shared.WARMTH])
        change = float(weight @ residual[warm]) / information
        shared = float(of_sum @ self.belief.covariance @ of_sum)
        expected = (shared + information) / information**2 + self._warmth_difference() ** 2
        if change * self._mean_per_kelvin >= 0.0 or change * change <= GATE * GATE * expected:
            return False
        self._filter.widen(np.eye(COUNT)[Shared.WARMTH], change * change)
        return True

    def _own_deviation(self, noise: Array) -> Array:
        """Return the deviations of residuals without what the shared states contribute [N]."""
        own = self.belief.own
        return np.asarray(np.sqrt(np.maximum(own[:, 0, 0] + 2.0 * own[:, 0, 2] + own[:, 2, 2], 0.0) + noise))

    def _open_hypothesis(self) -> None:
        """Open the hypothesis that the film became warmer, and go on without it, too.

        As if a touch of all taxels had begun with the stored blocks.
        """
        if self._unheated is not None:
            return
        self._uniform.begin()
        self._unheated = ForceErrorFilter(self._blocks[0].before.copy())
        self._unheated_touch = deepcopy(self._blocks[0].touch_before)
        for block in self._blocks:
            self._follow_unheated(block)
        shared = self._unheated.belief.shared
        self._expected_film, self._expected_rate = shared[[Shared.FILM, Shared.RATE]].tolist()
        newest = self._blocks[-1]  # the change in it is added when it is judged
        self._expected_film -= (self._expected_rate + newest.warming) * newest.duration

    def _follow_unheated(self, block: Block) -> None:
        """Follow the belief without the hypothesis, and what the touch leaves that there is without it."""
        unheated, touch = self._unheated, self._unheated_touch
        assert unheated is not None
        self._predict(unheated, block)
        self._measure_temperature(unheated, block, zeros=False)
        force = np.where(self.ignored, 0.0, np.maximum(block.mean - unheated.predicted(touch.matrix()), 0.0))
        shared = unheated.belief.shared
        slower = max(1.0 + float(shared[Shared.LEAK]), LEAST_LEAK) / block.leak - 1.0
        touch.advance(force, force, force, block.duration, slower, float(shared[Shared.WARMTH]))

    def _take_unheated(self, block: Block) -> None:
        """Take the belief without the hypothesis, which was wrong, and what the touch has left."""
        assert self._unheated is not None
        self._filter.belief = self._unheated.belief
        block.mean[:] -= self._unheated_touch.loops - self._touch.loops
        self._touch = deepcopy(self._unheated_touch)
        block.response[:] = self._touch.matrix()
        block.warming = self._touch.warming

    def _drop_hypothesis(self) -> None:
        """Keep the belief as it is: what the other one would say no longer matters."""
        self._uniform.close()
        self._unheated, self._unconfirmed = None, 0.0

    def _judge(self, block: Block, odd: Mask, where: Mask, residual: Array) -> None:
        """Act on the residuals of the newest block that no state explains."""
        shared, unheated = self.belief.shared, self._unheated
        claimed = shown = deviation = math.nan
        if unheated is not None:
            before, film = unheated.belief.shared, unheated.belief.covariance[Shared.FILM, Shared.FILM]
            self._expected_film += (self._expected_rate + block.warming) * block.duration
            claimed = float(shared[Shared.FILM]) - self._expected_film
            shown = float(before[Shared.FILM]) - self._expected_film
            deviation = math.sqrt(max(float(film), 0.0))
            shared = before  # the hypothesis itself makes the sensors' lag seem longer
        wait = UniformChange.CONFIRMATION + 2.0 * self._dynamics.sensor_lag(shared)
        if math.isnan(block.reading):
            wait += UniformChange.INTERVAL
        if self._uniform.is_refused(odd, where, claimed, shown, deviation, self._negligible, wait, block.duration):
            self._uniform.refuse()
            if unheated is not None:
                self._take_unheated(block)
                residual = block.mean - self._filter.predicted(block.response)
                odd = where & (residual > 0.0)
                self._forget_blocks()
        if not self._uniform.open:
            self._unheated = None
        self._unconfirmed = claimed - shown if self._unheated is not None else 0.0
        rests = self._has_rested()  # a release moves the rate, too
        if self._unheated is None and rests and self._was_misled():
            before = self._blocks[0].before.shared
            passed = sum(each.span for each in self._blocks)
            self._unconfirmed = float(
                self.belief.shared[Shared.FILM] - before[Shared.FILM] - before[Shared.RATE] * passed
            )
        self._restart_or_correct(block, odd, residual)

    def _restart_or_correct(self, block: Block, odd: Mask, residual: Array) -> None:
        """Restart unknown taxels with an unexplained residual, and widen errors where it is one of the baseline."""
        unknown = odd & ~self.offset_known
        if any_true(unknown):
            self._left_deviation[unknown] = np.minimum(REJECTED * self._left_deviation[unknown], self._runaway)
            self.restarts += int(np.count_nonzero(unknown))
            self._restart(unknown)
        errors = self._unexplained.update(
            odd & self.offset_known, residual, block.mean, np.sqrt(block.noise), block.duration
        )
        if errors is not None and errors.any():
            belief, below = self.belief, residual < -self._threshold
            released = odd & self.offset_known & below
            if any_true(errors & below) and self._find_hot_film(released, residual):
                errors &= ~released
            elif any_true(errors & below):
                # What touched since before the start, on these taxels or beside, was released.
                cooling = self._surroundings.dilated(released)
                warmth = (self._priors.warmth_mean * self._per_kelvin[cooling]) ** 2
                for i, j in ((0, 0), (0, 4), (4, 0), (4, 4)):
                    belief.own[cooling, i, j] += warmth
                belief.reset_force_error(released, block.mean, block.response, block.noise)
                left = float(residual[released].sum())  # it no longer warms the chip
                self._filter.admit(np.eye(COUNT)[Shared.RATE], (self._priors.touch_rate * left) ** 2)
                self._left_force *= self._recovery_left
                self._rested = self._unseen_for = 0.0
                self._left_force[cooling] = np.maximum(self._left_force, -residual)[cooling]
                errors &= ~released
                self._untouched_time[cooling] = 0.0
                self._zero_known, self._refutation.wide = True, False
                self._forget_blocks()  # to process them again would undo it
            for own in (belief.own, block.own_noise):  # there, too, if the block is processed again
                own[errors, 0, 0] += residual[errors] ** 2

    def _may_be_hot(self, belief: Belief | None = None) -> bool:
        """Return whether what touches may have warmed the film so much that force and warmth are hardly separable."""
        belief = belief or self.belief
        warmth, variance = belief.shared[Shared.WARMTH], belief.covariance[Shared.WARMTH, Shared.WARMTH]
        return self._hot or abs(float(warmth)) + math.sqrt(float(variance)) > GREATEST_WARMTH

    def _film_hides(self, belief: Belief) -> bool:
        """Return whether the film may be so warm that it hides a force."""
        return self._may_be_hot(belief) and self._hidden_share_of(belief) > 1.0

    def _may_be_warm(self) -> Mask:
        """Return the taxels of which the film may have been warmed by what touches, or has just touched."""
        # What a hot film holds below zero has an unknown force, and so an unknown warmth.
        warm: Mask = self._surroundings.dilated((self._touch.warm > WARMED) | self._below)
        return warm | self._beside if self._hot else warm

    def _find_hot_film(self, below: Mask, residual: Array) -> bool:
        """Return whether the film is hotter than was known.

        It is where a touch may have warmed it and forces stay below zero, as no object pulls. Only what has touched
        since before the start and is released does that, too, which may look like a brief touch. Such taxels are left
        as they are, until it has cooled.
        """
        if not self._begun or self._touched_for < NEGATIVE_TIME:  # as long as what it would explain
            return False
        possible = np.abs(residual) < HOTTEST_OBJECT * np.abs(self._per_kelvin)
        hot = any_true(below & self._may_be_warm() & possible)
        self._hot, self._shown_hot = self._hot or hot, self._shown_hot or hot
        return hot

    def _find_hot_touch(self) -> None:
        """Find whether what touches is so hot that force and warmth are hardly separable.

        No object pulls, yet the force of all contacts is below zero by more than less warmth explains.
        """
        counted = self._listed & (~self.ignored | self.informative)
        below = counted & (self._mean < -self._threshold)
        least = -GREATEST_WARMTH * float(np.abs(self._per_kelvin[below]).sum())
        if any_true(below) and self._mean[counted].sum() < least - GATE * self._total_deviation(counted):
            self._find_hot_film(below, self._mean)

    def _follow_touch(self, block: Block) -> None:
        """Follow the touch: one that lasts, and shows no hot film, ends what an earlier one has shown."""
        touches = any_true(block.touched)
        if touches and not self._touches:
            self._shown_hot, self._begun, self._touched_for = False, True, 0.0
        if self._touches and not touches and self._touched_for >= WARMING_TIMES * self._priors.warmth_time:
            self._hot = self._shown_hot
        self._touched_for += block.duration if touches else 0.0
        self._touches = touches

    def _set_zero(self, where: Mask, alone: Mask, block: Block) -> None:
        """Update by the zero forces of released taxels, of which some tell nothing of what taxels share."""
        noise = block.noise + TAIL_NOISE
        residual, sensitivity, _ = self._filter.innovation(block.mean, block.response, noise)
        self._filter.update_alone(alone, residual, sensitivity, noise)
        self._filter.update(where, residual, sensitivity, noise)

    def _end_unknown_touch(self, block: Block) -> None:
        """End the touches since before an interruption: where forces stay below zero, they are zero."""
        noise, mean = np.sqrt(block.noise), self._mean
        still = np.abs(mean - self._last_mean) <= GATE * math.sqrt(2.0) * noise
        ended = self._lower_bound.update(mean, still, block.duration)
        self._last_mean = mean
        if ended.any():
            self.belief.reset_force_error(ended, block.mean, block.response, block.noise)
            self._rested = 0.0
            self._forget_blocks()  # to process them again would undo it

    def _warmth_variance(self) -> Array:
        """Return the variance of the warmth of each taxel about the common one, as a force [N2]."""
        p, touch = self._priors, self._touch
        warmth = abs(float(self.belief.shared[Shared.WARMTH]))
        own = self._warmth_difference() * touch.warm
        contact = p.warmth_contact * warmth * touch.range
        variance: Array = self._per_kelvin**2 * (own**2 + contact**2)
        return variance

    def _shared_variance(self) -> Array:
        """Return the variances of what the forces share, but for what one object differs from others by [N2]."""
        known = np.delete(self._factor, OF_OBJECT, axis=1)
        variance: Array = np.einsum("ij,ij->i", known, known)
        return variance

    def _finish(self, block: Block) -> None:
        """Set the correction of the next scans, covariance and validity."""
        belief = self.belief
        self._follow_usual(block)
        self._find_hidden_press(block.duration)
        leaking = self._offset() * self._per_second()
        self._rate[:] = leaking + self._per_kelvin * (1.0 + belief.error[:, 3]) * self._film_rate()
        known = self._filter.predicted(block.response) + self._touch.loops
        self._correction[:] = known + 0.5 * block.duration * self._rate
        np.subtract(self._raw, self._correction, out=self.force)
        self._mean = block.mean - self._filter.predicted(block.response)
        self._set_covariance(block)
        self._find_hot_touch()
        self._recovering = max(0.0, self._recovering - block.duration)
        failed = ~(np.abs(self.force) <= self._runaway)
        if any_true(failed):
            self.restarts += int(np.count_nonzero(failed & ~self.ignored))
            self._restart(failed)
        self._confirm_offsets(block.duration)
        self.valid = self._is_valid(block.duration)
        self._prepare_compensation(block)
        self._start_block()

    def _prepare_compensation(self, block: Block) -> None:
        """Choose the untouched taxels that show the film's temperature scan by scan during a touch.

        Their small forces stay as they are until the next block. The share of a uniform change that is the film's is
        the gain of the Kalman filter of a random walk, in its limits of much and of little noise.
        """
        untouched = ~(self._touched | self.ignored) & self.offset_known
        # Fewer than half of the taxels are all at the edge of what touches, and change with it.
        enough = max(UniformChange.FEWEST, len(untouched) // 2)
        if not (self._touched.any() and self._uniform.observable and untouched.sum() >= enough):
            self._integration.watch_none()
            return
        watched = untouched.nonzero()[0]
        deviation = math.sqrt(float(self._noise_variance[watched].mean()) / len(watched))
        walk = abs(self._mean_per_kelvin) * math.sqrt(self.belief.covariance[Shared.RATE, Shared.RATE])
        walk *= block.duration / self._scans
        self._integration.watch(watched, self._mean[watched], walk / (walk + deviation))

    def _film_rate(self) -> float:
        """Return the rate of the film's temperature [K/s]."""
        shared = self.belief.shared
        if self._film_lag > 0.0:
            return float(shared[Shared.CHIP] - shared[Shared.FILM]) / self._film_lag
        return float(shared[Shared.RATE])

    def _step_noise(self, touched: Mask, span: float) -> Array:
        """Return the variance that steps of the signals add to the errors [N2]; what they add in a touch is known."""
        stepped = self._jumps.variance(span)
        self._stepped = np.where(touched, self._stepped + stepped, 0.0)
        return stepped

    def _follow_usual(self, block: Block) -> None:
        """Follow the errors of the forces and their offsets slowly, where nothing touches.

        A press that grows too slowly to be seen moves both: its beginning is absorbed, and so is its growth, as an
        offset. What a film that warms makes of them is known as far as the taxel's response is.
        """
        error, offset = self.belief.error[:, 0], self.belief.error[:, 1]
        self._untouched_time = np.where(self._listed | ~self.offset_known, 0.0, self._untouched_time)
        self._usual += block.duration * (self._offset() + self._usual_offset - offset) * self._per_second()
        self._usual += self._per_kelvin * (self._film_rate() * block.duration) * self.belief.error[:, 3]
        self._untouched_time += block.duration * ~self._beside
        # Twice as fast as their age: what was estimated early, and so less well, is soon forgotten.
        share = 2.0 * block.duration / np.clip(self._untouched_time, 2.0 * block.duration, ABSORBED_TIME)
        share *= ~self._beside
        self._usual += share * (error - self._usual)
        self._usual_offset += share * (offset - self._usual_offset)

    def _find_hidden_press(self, duration: float) -> None:
        """Find whether something may touch that warmth hides.

        What presses so slowly that zeros have absorbed it has let the reading fall: its errors are the usual ones.
        """
        # While something is released, it may look hot from one block to the next.
        lasts = len(self._blocks) == LAG and self._film_hides(self._blocks[0].before)
        hides = lasts and self._film_hides(self.belief)
        if self._hidden_share <= 1.0:
            self._hidden_touch.forget()
        self._hidden_touch.follow_touch(self._touched, self._mean, self._thermal_contact, hides, duration)
        if not hides:
            return
        fallen = np.where(self._untouched_time < ABSORBED_TIME, 0.0, -self._unusual())
        pressed = ~self._touched & ~self.ignored & self.offset_known & (fallen > self._hidden_touch.least)
        if any_true(pressed):
            self._hidden_touch.pressed |= pressed
            error, own = self.belief.error, self.belief.own
            usual = np.column_stack((self._usual, self._usual_offset))
            for state in (0, 1):
                own[pressed, state, state] += (error[pressed, state] - usual[pressed, state]) ** 2
                error[pressed, state] = usual[pressed, state]
            self._forget_blocks()  # to process them again would undo it

    def _absorbed(self) -> Array:
        """Return what a slow press may have lost to zeros [N].

        It counts in the deviation only: the filter would explain the rest of the press by it. What the untouched taxels
        have in common by the pattern of their pyroelectric responses is what the temperature of the film seemed to be
        until the sensors said otherwise, and no press.
        """
        return np.maximum(self._unusual(), 0.0)

    def _unusual(self) -> Array:
        """Return by how much the error of each force exceeds its usual one [N], but for what seemed a warm film."""
        unusual: Array = self.belief.error[:, 0] - self._usual
        untouched = ~(self._touched | self.ignored)
        if self._uniform.observable and np.count_nonzero(untouched) >= UniformChange.FEWEST:
            unusual = unusual - self._per_kelvin * median((unusual / self._per_kelvin)[untouched])
        return unusual

    def _set_covariance(self, block: Block) -> None:
        counted = ~self.ignored | self.informative
        held, belief = np.maximum(self.force * (self._touched & counted), 0.0), self.belief
        own, self._factor[:, :COUNT] = self._filter.covariance_root(block.response)
        # The covariance without the responses to the touch itself, and without what the taxel's own response to a
        # temperature contributes, which grows during a touch only.
        sensitivity = block.response * ~OF_TOUCH + belief.slope[:, 0]
        by_response = belief.own[:, 0, 3] ** 2 / np.maximum(belief.own[:, 3, 3], NEGLIGIBLE)
        # So does its warmth, until it is free.
        warms = self._beside & (belief.own[:, 4, 4] > 0.0)
        by_warmth = np.where(warms, belief.own[:, 0, 4] ** 2 / np.where(warms, belief.own[:, 4, 4], 1.0), 0.0)
        alone = np.maximum(own - by_response - by_warmth, 0.0)
        self._untouched_variance = alone + self._filter.shared_variance(sensitivity)
        self._integration.held[:] = held
        self._factor[:, COUNT] = held * np.hypot(self._gain_common, NONLINEARITY * held)
        self._factor[:, COUNT + 1] = self._per_kelvin * self._unconfirmed
        self._lost[~self._touched] = 0.0
        absorbed = self._absorbed()
        self._follow_hidden(block, absorbed)
        self._factor[:, COUNT + 2] = absorbed + self._hidden
        self._factor[:, OF_OBJECT] = self._per_kelvin * self._touch.warm * self._touched * self._object_deviation()
        self._factor[:, COUNT + 4] = self._lost
        own -= np.minimum(own, self._lost**2)  # in the covariance as each taxel's own
        own += (self._gain * held) ** 2 + (self._leak * self._touch.leaked) ** 2
        self._own = own

    def _object_deviation(self) -> float:
        """Return by how much the warmth of an object may differ from that of others, beyond what is unknown of it [K].

        It counts in the deviation only: as a state, it would make the common warmth follow each object.
        """
        known = float(self.belief.covariance[Shared.WARMTH, Shared.WARMTH])
        return math.sqrt(max(self._warmth_difference() ** 2 - known, 0.0))

    def _warmth_difference(self) -> float:
        """Return by how much one taxel, or one object, differs in warmth from others [K]."""
        return self._priors.warmth_least + self._priors.warmth_spread * abs(float(self.belief.shared[Shared.WARMTH]))

    def _follow_hidden(self, block: Block, absorbed: Array) -> None:
        """Follow what the warmth of an object may hide of a touch that no contact lists yet.

        What the taxel reads, what zeros have absorbed of it and what is hidden cause that warmth together. What a tap
        leaves of its force is no touch, on the taxels beside it neither: warmth hides none of it within a block.
        """
        mean = np.maximum(self._mean, 0.0)
        fallen = self._felt - mean
        tap = (fallen > TAP_SHARE * self._felt) & (fallen**2 > GATE**2 * 2.0 * block.noise)
        self._tapped = self._touched & (self._tapped | tap)
        self._felt = mean
        touch = self._touched & ~self._tapped & ~any_true(self._listed)
        read = np.where(touch, mean + absorbed, 0.0)
        own = self.belief.own
        variance = block.noise + np.maximum(own[:, 0, 0] + 2.0 * own[:, 0, 2] + own[:, 2, 2], 0.0)
        presses = (read**2 > SURPRISING**2 * variance) & ~self._surroundings.dilated(self._tapped)
        felt = read + self._hidden * presses
        warmth = float(self.belief.covariance[Shared.WARMTH, Shared.WARMTH])
        kelvin = math.hypot(float(self.belief.shared[Shared.WARMTH]), math.sqrt(warmth))
        share = -np.expm1(-felt * self._priors.warmth_force_spread / self._priors.warmth_force)
        most = np.abs(self._per_kelvin) * kelvin * share
        self._hidden += -math.expm1(-block.duration / self._priors.warmth_time) * (most - self._hidden)

    def _is_valid(self, duration: float) -> bool:
        sound = self.offset_known & (self._unexplained.below == 0.0) & ~self._lower_bound.mask
        sound = sound & (self.force <= BEYOND_RANGE * (self._runaway / RUNAWAY)) | self.ignored
        counted = ~self.ignored | self.informative
        touched = self._touched & counted
        any_touched = any_true(touched)
        total = float(self.force[counted].sum())
        deviation = self._total_deviation(counted)
        self._refutation.end_block(duration, total, deviation)
        self._recent_force.append(abs(total))
        if self.touch_at_start and not self._zero_known:
            return False
        if self._recovering > 0.0 or not sound.all():
            return False
        warmed = float(np.abs(self._per_kelvin * self.belief.shared[Shared.WARMTH] * self._touch.warm).sum())
        if (
            not any_touched
            and abs(self._unconfirmed) <= self._negligible
            and warmed <= LEAST_DEVIATION * self._threshold
            and not self._hidden_touch.may_touch
        ):
            return True
        if self._hidden_touch.may_touch or self._may_be_hot():
            return False
        greatest, present = max(self._recent_force), abs(total)
        if total < -SURPRISING * deviation - self._threshold:
            return False  # no object pulls
        noise = math.sqrt(float(self._noise_variance[counted].sum()))
        fall = max((before - after for before, after in pairwise(self._recent_force)), default=0.0)
        least = present - DECIDED * max(fall, 0.0) - GATE * noise
        force = greatest if present < RELEASING * greatest else least  # a release
        return deviation <= max(self.max_relative_uncertainty * force, LEAST_DEVIATION * self._threshold)

    def _total_deviation(self, counted: Mask) -> float:
        """Return the standard deviation of the total force of some taxels [N]."""
        return math.sqrt(self._own[counted].sum() + np.square(self._factor[counted].sum(axis=0)).sum())

    def _confirm_offsets(self, duration: float) -> None:
        """Mark offsets as known once the array has been still."""
        if (self.offset_known | self.ignored).all():
            return
        # What all taxels have in common may be the film's temperature: judged by `UniformChange`, and no motion.
        warming = self._uniform.observable or self._warms()
        at_rest = self._rest.update(self._integration.signal, self.ignored, duration, warming)
        if self._rest.moved:
            self._restart(~self.offset_known & ~self.ignored)
        elif at_rest and len(self._blocks) >= STILL_BLOCKS:
            self.offset_known |= (self.belief.own[:, 1, 1] <= (0.5 * self._threshold * self._tau) ** 2) & ~self.ignored

    def _warms(self) -> bool:
        """Return whether the temperature of the chip certainly changes."""
        rate, variance = self.belief.shared[Shared.RATE], self.belief.covariance[Shared.RATE, Shared.RATE]
        return abs(float(rate)) > 3.0 * math.sqrt(variance)

    def start(self, charge: Array) -> None:
        """Start with a scan that has no predecessor.

        Parameters
        ----------
        charge : ndarray of float64, shape [rows * cols]
            Charge densities [C/m2].
        """
        self._integration.start(charge)
        self._integration.clipped[:] = 0.0
        self._leaked = self._raw - self._integration.signal
        self._last_duration = BLOCK
        signal, belief = self._integration.signal, self.belief
        if not math.isnan(self._sensors):
            p = self._priors
            mean, covariance = start_mean(p), start_covariance(p)
            mean[Shared.EARLIER] = belief.shared[Shared.EARLIER]
            covariance[Shared.EARLIER, Shared.EARLIER] = belief.covariance[Shared.EARLIER, Shared.EARLIER]
            self._filter.restart_temperature(self._sensors, mean, covariance)
            self._leaked_since = 0.0
            self._unread, self._reading = 0.0, math.nan  # it says what these temperatures are, and nothing else
        remaining = np.where(self.offset_known, signal - self._offset(), 0.0)
        known = ~self.ignored
        self._lower_bound.start(self.force * known, remaining * known)
        self._last_mean = np.full(len(signal), math.nan)
        self._begun, self._touches = False, True
        self.force[:] = self._integration.held[:] = np.maximum(remaining, 0.0)
        self._correction[:] = self._raw - self.force
        shown, variance = self._correction - self._touch.loops, self._noise_variance + belief.own[:, 1, 1]
        belief.reset_force_error(np.ones(len(signal), np.bool_), shown, self._touch.matrix(), variance)
        belief.integrate(*self._integrated(-0.5 * self._last_duration))
        self._usual[:] = belief.error[:, 0]
        self._usual_offset[:] = belief.error[:, 1]
        self._forget_blocks()
        self._drop_hypothesis()
        self._recent_force.clear()
        self._unexplained.reset()
        self._release.restart()
        self._thermal_contact.reset()
        self._started = True
        self._rest.start(signal)
        self._integration.watch_none()
        self._restart(~self.offset_known)
        self._start_block()

    def _restart(self, where: Mask) -> None:
        """Restart the masked taxels: no force, and the signal is offset, or charge left by an earlier force.

        After each rejection the deviation of that charge is larger.
        """
        if not where.any():
            return
        belief, noise = self.belief, self._noise_variance
        new, known = where & ~self.offset_known, where & self.offset_known
        belief.slope[where] = 0.0
        belief.error[where, 3] = belief.error[where, 4] = 0.0
        belief.error[where, 2] = 0.0
        belief.own[where] = 0.0
        belief.reset_force_error(where, self._raw - self._touch.loops, self._touch.matrix(), noise)
        belief.own[where, 3, 3] = self._priors.pyroelectric**2
        # The offset has the noise of the signal that it is set to; so has the force.
        # A film that warms generates charge, which is no offset: that of the present rate, as far as it has lasted.
        present = 1.0 / self._per_second()
        charge = present * self._per_kelvin * -np.expm1(-max(self._age - self._film_lag, 0.0) / present)
        drift, rate = belief.shared[[Shared.DRIFT, Shared.RATE]]
        belief.error[new, 1] = (self._integration.signal - self._tau * drift - charge * rate)[new]
        belief.slope[new, 1, Shared.RATE] = -charge[new]
        belief.own[new, 0, 0] = belief.own[new, 0, 1] = belief.own[new, 1, 0] = noise[new]
        belief.own[new, 1, 1] = noise[new] + self._left_deviation[new] ** 2
        self._left_deviation[known] = self._left + np.abs(self._integration.signal - self._offset())[known]
        belief.own[known, 1, 1] = (RESTART_DEVIATION * self._threshold) ** 2
        belief.integrate(*self._integrated(np.where(where, -0.5 * self._last_duration, 0.0)))
        self._rate[where] = (self._offset() * self._per_second())[where]
        self.offset_known[where] = False
        self._integration.clipped[where] = 0.0
        self._correction[where] = self._raw[where]
        self.force[where] = self._integration.held[where] = 0.0
        self._usual[where] = belief.error[where, 0]
        self._usual_offset[where] = belief.error[where, 1]
        self._forget_blocks()

    def _start_block(self) -> None:
        may_remove = self._uniform.pause <= 0.0 and self._uniform.observable and not any_true(self._touched)
        self._integration.start_block(may_remove)
