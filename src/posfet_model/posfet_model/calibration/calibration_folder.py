# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The one folder in which calibrations are loaded and saved on request of other programs."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import Final

from posfet_model._lib.shown import one_line, shown
from posfet_model.calibration.calibration_file import check_replaceable, load_calibration, save_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError, expanded
from posfet_model.sensor.description import Sensor

SUFFIX: Final = ".yaml"
"""End of the name of every file."""

MAX_NAME: Final = 200
"""Largest length of a name."""


def write_problem(folder: Path) -> str:
    """Return why no calibration can be written into a folder, in one line; '' if one can, or if it can be made.

    Parameters
    ----------
    folder : Path
        Path of the folder.
    """
    there = next(each for each in (folder, *folder.parents) if os.path.lexists(each))
    if there.is_dir() and os.access(there, os.W_OK | os.X_OK):
        return ""
    reason = "is not writable" if there.is_dir() else "is not a folder"
    return one_line(f"{folder}: the calibration folder cannot be written: {there} {reason}")


class CalibrationFolder:
    """Calibrations by name. A name can neither leave the folder nor make anything but a calibration be overwritten.

    A name is that of a file or a relative path, ends in ``.yaml``, and no part of it begins with a point.

    Parameters
    ----------
    folder : str
        Path of the folder, which the first `save` makes; ~ is the home folder.
    sensor : Sensor
        The sensor to which the calibrations belong.

    Raises
    ------
    ConfigError
        At construction, if ~ is no known home folder. The methods raise it with one line for a name that is not
        allowed, and for a file that cannot be used.
    """

    def __init__(self, folder: str, sensor: Sensor) -> None:
        self.root = Path(os.path.realpath(expanded(folder)))
        """The folder, without symbolic links."""
        self._sensor = sensor

    @property
    def problem(self) -> str:
        """Why `save` cannot write, in one line; '' if it can. What is there can be loaded nevertheless."""
        return write_problem(self.root)

    def load(self, name: str) -> Calibration:
        """Return the calibration of a name."""
        path = self._path(name)
        if not self._holds(path):
            raise self._refused(name)
        return load_calibration(path, self._sensor)

    def save(self, name: str, calibration: Calibration) -> Path:
        """Write a calibration and return its path.

        Parameters
        ----------
        name : str
            Name of the file. An existing one is replaced only if it is a calibration of the same sensor.
        calibration : Calibration
            The calibration.
        """
        path = self._path(name)
        if self.problem:
            raise ConfigError(self.problem)
        if os.path.lexists(path):
            self._check_replaceable(path)
        try:
            self.root.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{self.root}: the calibration folder cannot be made: {error.strerror}") from error
        save_calibration(path, self._sensor, calibration)
        return path

    def _path(self, name: str) -> Path:
        """Return the path of a name, of which only the last part may be a symbolic link."""
        path = PurePosixPath(name)
        plain = name.isprintable() and len(name) <= MAX_NAME and not path.is_absolute()
        if not plain or not name.endswith(SUFFIX) or any(part.startswith(".") for part in path.parts):
            raise self._refused(name)
        folder = Path(os.path.realpath(self.root / path.parent))
        if not self._holds(folder):
            raise self._refused(name)
        return folder / path.name

    def _holds(self, path: Path) -> bool:
        return Path(os.path.realpath(path)).is_relative_to(self.root)

    def _refused(self, name: str) -> ConfigError:
        return ConfigError(
            f"{shown(name)}: must be the name of a file in the calibration folder {one_line(str(self.root))}, ending "
            f"in {SUFFIX}, for instance thumb{SUFFIX}"
        )

    def _check_replaceable(self, path: Path) -> None:
        if path.is_symlink():
            raise ConfigError(f"{path}: exists and is a symbolic link, so it is not replaced: choose another name")
        check_replaceable(path, self._sensor)
