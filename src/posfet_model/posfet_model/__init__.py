# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""POSFET tactile sensing: device physics, force estimation and contact tracking. Needs NumPy and PyYAML, not ROS.

The names that most programs need are attributes of this package, and each subject is a subpackage. Both are imported on
first use, so that ``import posfet_model`` itself loads nothing else.

Examples
--------
Read the sensor description of a shipped array, and a property of the device:

>>> import posfet_model
>>> sensor = posfet_model.load_sensor()
>>> sensor.layout.taxels
25
>>> print(f"{posfet_model.device.taxel.Taxel().volts_per_newton():.3f} V/N")
0.894 V/N

Feed scans to a reconstructor. It reuses its results; `snapshot` returns a copy that the next scan does not overwrite:

>>> reconstructor = posfet_model.Reconstructor(sensor)
>>> scan = posfet_model.Scan.empty(sensor.layout.id, sensor.layout.taxels)
>>> result = reconstructor.process(scan).snapshot()
>>> result.valid, len(result.contacts)
(False, 0)
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from posfet_model import (
        amplifier,
        calibration,
        contacts,
        design,
        device,
        estimation,
        figures,
        reconstruction,
        sensor,
        spice,
    )
    from posfet_model.calibration.taxel_calibration import Calibration
    from posfet_model.config import ConfigError
    from posfet_model.contacts.tracker import Contact
    from posfet_model.reconstruction.reconstructor import Reconstructor
    from posfet_model.reconstruction.taxel_faults import TaxelStatus
    from posfet_model.sensor.description import load_sensor
    from posfet_model.sensor.scan import Scan

__version__ = "0.2.0"

__all__ = [
    "Calibration",
    "ConfigError",
    "Contact",
    "Reconstructor",
    "Scan",
    "TaxelStatus",
    "__version__",
    "amplifier",
    "calibration",
    "contacts",
    "design",
    "device",
    "estimation",
    "figures",
    "load_sensor",
    "reconstruction",
    "sensor",
    "spice",
]

_HOME: Final = {
    "Calibration": "calibration.taxel_calibration",
    "ConfigError": "config",
    "Contact": "contacts.tracker",
    "Reconstructor": "reconstruction.reconstructor",
    "Scan": "sensor.scan",
    "TaxelStatus": "reconstruction.taxel_faults",
    "load_sensor": "sensor.description",
}
"""Module in which each name is defined; every other name of `__all__` is a subpackage."""


def __getattr__(name: str) -> Any:
    """Import a name or a subpackage on first use. Raises AttributeError for any other name."""
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    if name in __all__:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
