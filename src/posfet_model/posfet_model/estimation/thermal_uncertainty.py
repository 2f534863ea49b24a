"""What the film's warmth makes of forces and offsets, and of what is known of them.

One temperature, but taxels that answer unevenly: what warming leaves in the signals leaks away as force does, and looks
like an offset while it lasts; what is not known of the film's temperature is in all forces alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import upper_median
from posfet_model.estimation.common_mode import CommonMode
from posfet_model.estimation.film_temperature import FilmTemperature
from posfet_model.estimation.settings import CLEARER, LEAST_UNEVEN, UNEVEN_MEMORY, UNTOLD


class Warming:
    """Follows the film's warmth; `per_kelvin` times it is what each taxel reads of it [N]."""

    def __init__(
        self, film: FilmTemperature, common: CommonMode, per_kelvin: NDArray[np.float64], uneven: float, recorded: bool
    ) -> None:
        """Take the signals of the taxels per temperature [N/K], and the spread [1] that is left of them.

        recorded: they are by a recording, so that a taxel that does not answer is known.
        """
        self.film = film
        self.common = common
        self.per_kelvin = per_kelvin
        self.uneven = 0.0
        """Standard deviation of what the last block's warming did unevenly to each force [N]."""
        self.warmth = 0.0
        """By how much the film was taken for warmer since the start [K]; to be written to."""
        self._before = 0.0  # the same when the block began
        self._unleaked = np.zeros(len(per_kelvin))
        self._gone_before = np.zeros(len(per_kelvin))  # what had leaked of the warmth when a touch began [K]
        self._gone_told = np.zeros(len(per_kelvin))  # and when the taxels told the temperature last
        self._typical = abs(upper_median(per_kelvin))
        self._share = uneven
        self._recorded = recorded
        self._swing = 0.0  # how far the film has been from where it was before something touched [K]
        self._restless = False
        self._doubt = 0.0  # the greatest since offsets began to be learnt [K]
        self._age = 0.0  # time since the first scan [s]

    @property
    def common_variance(self) -> float:
        """Variance of the forces [N2] that all taxels share: what is not known of the film."""
        return self.common.told_variance if self._told else self.film_variance

    @property
    def film_variance(self) -> float:
        """What the sensors leave unknown of the film's temperature, as a variance of the forces [N2]."""
        return (self.film.standard_deviation * self._typical) ** 2

    @property
    def uneven_variance(self) -> float:
        """Variance [N2] that each taxel has alone since the last correction."""
        # Until the next one the uneven part of a warming adds up, as it did in the last block.
        return (2.0 * self.uneven) ** 2

    @property
    def _told(self) -> bool:
        # A taxel that does not answer shows no warmth either, and without calibration it is not known to be one.
        return self.common.told and self._recorded

    @property
    def told_leak(self) -> NDArray[np.float64]:
        """What leaked since a touch began of the charge of warmth, as far as the taxels told it together [N].

        What is not known of the leak that all share makes no error of it: the others would show it.
        """
        leaked: NDArray[np.float64] = (self._gone_told - self._gone_before) * self.per_kelvin
        return leaked

    def begin(self, where: NDArray[np.bool_]) -> None:
        """Take note that the masked taxels begin to be touched."""
        gone = self.warmth - self._unleaked[where]
        self._gone_before[where] = self._gone_told[where] = gone

    @property
    def left(self) -> NDArray[np.float64]:
        """What warming has left in the signals up to the last block [N]; all offset but this was there before."""
        left: NDArray[np.float64] = self._unleaked * self.per_kelvin
        return left

    def close(self, elapsed: float, tau: NDArray[np.float64], least: float, touched: bool) -> float:
        """End a block of `elapsed` [s]; return the standard deviation it adds to each force [N].

        tau [s] are the time constants of the leak; below `least` [N] the uneven part is forgotten at once.
        """
        change = self.warmth - self._before
        self._before = self.warmth
        self._unleaked += change
        self._unleaked *= np.exp(-elapsed / tau)
        if touched and self._told:
            np.subtract(self.warmth, self._unleaked, out=self._gone_told)
        if touched:
            # Nothing is corrected: what counts is how far the film is from where it was before.
            before, self._swing = self._swing, max(self._swing, self.common.since_touch)
            change = self._swing - before
        else:
            self._swing = 0.0
        if not change and not self.uneven:
            return 0.0
        # The gain for temperature is wrong the same way all the time: deviations add up, not variances.
        now = abs(change) * self._typical * self._share
        self.uneven = max(now, UNEVEN_MEMORY * self.uneven) if now > LEAST_UNEVEN * least else now
        return self.uneven

    def misled(self, elapsed: float) -> tuple[bool, bool]:
        """Return whether offsets not known yet may have been learnt of the film's warmth, and whether known ones may.

        To be called once a block of `elapsed` [s].
        """
        film, was_restless = self.film, self._restless
        doubt = film.standard_deviation
        self._restless = not film.quiet
        clearer = was_restless and (film.quiet or doubt < CLEARER * self._doubt)
        begins = self._restless and not was_restless
        self._doubt = doubt if clearer or begins else max(self._doubt, doubt)
        self._age += elapsed
        return clearer or begins, begins and self._age < UNTOLD
