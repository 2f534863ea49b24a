"""Ground truth of a simulated board: what the scene did to the sensor at the time of one scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from posfet_driver.loads import ObjectsState


@dataclass(frozen=True)
class Truth:
    """What the scene did to the sensor at the time of one scan."""

    sequence: int
    """Number of the scan."""
    time: float
    """When the scan was taken [s] since the board started."""
    force: NDArray[np.float64]
    """Force on each taxel [N], shape [rows * cols], positive when pushed into the sensor."""
    chip_temperature: float
    """Temperature of the chip [degC]."""
    film_temperature: float
    """Temperature of the film [degC]."""
    taxel_status: NDArray[np.uint8]
    """What is wrong with each taxel, TAXEL_* of posfet_msgs/TactileImage, shape [rows * cols]."""
    objects: ObjectsState
    """The objects, and what they do."""
