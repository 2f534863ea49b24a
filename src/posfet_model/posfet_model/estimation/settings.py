"""What the observer of static force takes for granted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

LONG_STEP: Final = 0.05
"""h/tau above which it matters when within a step the force changed."""

RUNAWAY: Final = 4.0
"""A taxel whose force grew beyond this many times its greatest one starts anew [1]; saturated ones may exceed it."""

RESTLESS_WORTH: Final = 0.1
"""Worth of time for learning an offset while the temperature changes [1]."""

CLEARER: Final = 0.5
"""Offsets are learnt anew once the film's temperature is known with this share of the doubt there was [1]."""

UNTOLD: Final = 0.5
"""A chip that begins to warm so soon after the start did so before: its sensors speak ten times a second [s]."""

REFUTED: Final = 3.0
"""Factor by which more is taken to be left of an earlier force, when less was refuted [1]."""

UNEVEN_MEMORY: Final = 0.8
"""Share of the uneven part of a block's warming that counts for the next one at least: it comes in jerks [1]."""

LEAST_UNEVEN: Final = 1e-3
"""An uneven part below this is forgotten, in contact thresholds [1]."""

KNOWN_BEFORE: Final = 0.1
"""Standard deviation, in contact thresholds, of an offset that was known when its taxel had to start anew [1]."""

ALIKE: Final = 2.0
"""Offsets of an untouched array differ by no more from their median, in contact thresholds; else wait longer [1]."""

DOUBT: Final = 0.2
"""Standard deviation, in contact thresholds, from which a small force is more likely an error than a slow press [1]."""


@dataclass(frozen=True)
class ObserverSettings:
    """What the observer takes for granted. All values are assumed."""

    block: float = 0.02
    """Duration of a block of scans, after which zero and offset are corrected [s]."""
    settle: float = 0.1
    """A taxel must agree with a constant force for this long before its offset counts as known [s]."""
    first_deviation: float = 5e-5
    """Standard deviation of what is left of an earlier force at the start, as a voltage [V]; refuted, it grows."""
    flicker: float = 1e-5
    """1/f noise of the amplifier, which lets the offset wander [V/sqrt(Hz)] at 1 Hz."""
    temperature_wander: float = 1e-4
    """Random walk of the film's temperature that the chip's sensors do not see [K/sqrt(s)]."""
    uneven: float = 0.1
    """Standard deviation of the taxels' signals for temperature, without calibration [1]."""
    uneven_calibrated: float = 0.02
    """The same with calibration [1]."""
    gain: float = 0.05
    """Standard deviation of a taxel's gain, left after calibration [1]."""
    leak_shared: float = 0.1
    """Standard deviation by which the time constants of the leak all differ alike from what they are told to be [1]."""
    leak_shared_calibrated: float = 0.07
    """The same with calibration: what temperature and age make of it [1]."""
    leak_own: float = 0.1
    """The same by which each differs by itself, without calibration [1]."""
    leak_own_calibrated: float = 0.02
    """The same with calibration [1]."""
    gate: float = 5.0
    """Standard deviations within which a mean of a block agrees with what was expected [1]."""
    zero_slew: float = 0.1
    """Fastest motion of a settled taxel's zero, in contact thresholds per second [1/s]: slower presses are lost."""
    zero_rise: float = 0.25
    """The same of one that is below zero, where no press is [1/s]."""
    steady: float = 0.2
    """A force below zero is a wrong zero once it has been steady for this long [s]."""
    resume: float = 0.04
    """Nothing is valid for this long after an interruption [s]."""
    recover: float = 2.0
    """A taxel that stays below zero for this long without becoming steady starts anew [s]."""
