# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Parameters as data, without ROS: the type `Parameter`, and the table of the model node.

From these tables come the parameters of the nodes with their ROS descriptors (`ros.ros_parameters`), the arguments of
the launch file and of ``posfet bringup`` (`posfet.arguments`), the help of command-line options with the same meaning,
and ``docs/parameters.md``. The driver and the simulated board have tables of their own in their packages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, TypeAlias

from posfet_model._lib.shown import interval
from posfet_model.estimation.settings import MAX_RELATIVE_UNCERTAINTY
from posfet_model.sensor.defaults import DEFAULT_SENSOR, FRAME_CHOICES

Scalar: TypeAlias = "bool | int | float | str"
Value: TypeAlias = "Scalar | list[str]"

STANDARD: Final = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Parameters that every node has or may be given; with a dot at the end: all that begin so."""

_TYPES: Final = {bool: "bool", int: "integer", float: "double", str: "string", list: "string array"}
_IN_WORDS: Final = {
    bool: "true or false",
    int: "a whole number",
    float: "a number with a decimal point",
    str: "text",
    list: "a list of texts",
}


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node or argument of the launch file. Its type is that of its default."""

    name: str
    default: Value
    description: str
    unit: str = ""
    """Empty: dimensionless, or not a number."""
    low: float = -math.inf
    """Smallest value allowed, in `unit`."""
    high: float = math.inf
    """Largest value allowed, in `unit`."""
    choices: tuple[str, ...] = ()
    """Texts allowed; empty: any text."""
    empty: str = ""
    """Meaning of the empty text, where it is the default."""
    read_only: bool = True
    """Whether it is set at start-up only."""
    fixed: str = "it is used at start-up only"
    """Why it is read-only, if it is."""
    frame: bool = False
    """Whether it names a TF frame, which does not begin with a slash."""

    def __post_init__(self) -> None:
        reason = self.check(self.default)
        if reason:
            raise ValueError(f"{self.name}: the default {reason}")

    @property
    def type_name(self) -> str:
        """Name of the ROS parameter type."""
        return _TYPES[type(self.default)]

    @property
    def bounded(self) -> bool:
        """Whether the value has a smallest or a largest value."""
        return math.isfinite(self.low) or math.isfinite(self.high)

    @property
    def range(self) -> str:
        """The range as an interval, '' without one."""
        if not self.bounded:
            return ""
        if isinstance(self.default, int):
            return f"[{self.low:.0f}, {self.high:.0f}]"
        return interval(self.low, self.high)

    @property
    def summary(self) -> str:
        """The description with the meaning of an empty text."""
        return f"{self.description}; empty: {self.empty}" if self.empty else self.description

    @property
    def allowed(self) -> str:
        """The allowed values in words, with their unit."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        words = _IN_WORDS[type(self.default)]
        if self.frame:
            return f"{words} without a slash at its front"
        return f"{words} in {self.range} {self.unit}".strip() if self.bounded else words

    @property
    def default_text(self) -> str:
        """The default as it is written in a launch argument."""
        return _as_text(self.default)

    @property
    def help(self) -> str:
        """Description, unit and default for argparse, which needs the percent sign doubled."""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.summary}{unit} (default: {self.default_text or 'empty'})".replace("%", "%%")

    def check(self, value: object) -> str:
        """Return '' for an allowed `value`, otherwise what is allowed and what was given.

        Parameters
        ----------
        value : object
            Value to check.

        Examples
        --------
        >>> rate = Parameter("rate", 1000.0, "Scan rate", unit="Hz", low=1.0, high=4000.0)
        >>> rate.check(500.0)
        ''
        >>> rate.check(float("nan"))
        'must be a number with a decimal point in [1, 4000] Hz, got nan'
        """
        fits = type(value) is type(self.default)
        if fits and isinstance(value, (int, float)) and not isinstance(value, bool):
            fits = math.isfinite(value) and self.low <= value <= self.high
        if fits and isinstance(value, str):
            fits = (bool(value) or not self.default) and not (self.frame and value.startswith("/"))
        if fits and isinstance(value, list):
            fits = all(isinstance(item, str) for item in value)
        if fits and self.choices:
            fits = value in self.choices
        return "" if fits else f"must be {self.allowed}, got {value!r}"

    def parse(self, text: str) -> Scalar:
        """Return the value that a launch argument gives as text.

        Parameters
        ----------
        text : str
            Value as text.

        Raises
        ------
        ValueError
            If the text is not an allowed value; the message says what is allowed and what was given.

        Examples
        --------
        >>> Parameter("bitrate", 0, "Bitrate", unit="bit/s", low=0, high=1_000_000).parse("500000")
        500000
        """
        value: Scalar = text
        if isinstance(self.default, bool):
            value = {"true": True, "false": False}.get(text, text)
        elif isinstance(self.default, (int, float)):
            try:
                value = type(self.default)(text)
            except ValueError:
                value = text
        if self.check(value):
            raise ValueError(f"must be {self.allowed}, got '{text}'")
        return value


def _as_text(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return f"[{', '.join(repr(item) for item in value)}]"
    return str(value)


SENSOR_FILE: Final = Parameter(
    "sensor_file",
    DEFAULT_SENSOR,
    "Sensor description: path of a YAML file, or name of a shipped one",
    fixed="buffers and messages have the size of its array",
)
CAN_FD: Final = Parameter(
    "can_fd",
    "auto",
    "Frames of the board: true for CAN FD, false for classic CAN, auto as in the sensor file",
    choices=FRAME_CHOICES,
    fixed="board and driver agree on it when they start",
)
SERIAL: Final = Parameter(
    "serial",
    "",
    "Serial number of this sensor, which its calibration file must have, too",
    empty="as in the sensor file",
    fixed="`info`, diagnostics and calibration carry it",
)
SENSOR: Final = (SENSOR_FILE, CAN_FD, SERIAL)
"""The parameters that describe the sensor to a node."""
FRAME_ID: Final = Parameter(
    "frame_id",
    "",
    "Frame of the array: x along columns, y along rows, z outward",
    empty="<namespace>_array",
    fixed="TF and other nodes have it already",
    frame=True,
)
PARENT_FRAME: Final = Parameter(
    "parent_frame", "", "TF frame that the array is mounted on", empty="no transform is broadcast", frame=True
)
MOUNT_POSE: Final = Parameter(
    "mount", "0 0 0 0 0 0", "Pose of the array in parent_frame: x y z [m] roll pitch yaw [rad]"
)
AUTOSTART: Final = Parameter(
    "autostart", True, "Configure and activate at start-up; false: wait for lifecycle transitions"
)
RELIABILITY: Final = Parameter(
    "reliability",
    "reliable",
    "Reliability of the topics with scans, forces and contacts; best_effort is published in less time, and reaches "
    "only subscribers that ask for best effort",
    choices=("reliable", "best_effort"),
    fixed="publishers are created with it",
)
MOUNT: Final = (PARENT_FRAME, MOUNT_POSE)
CALIBRATION_FILE: Final = Parameter(
    "calibration_file",
    "",
    "Calibration of this individual sensor: path of a YAML file",
    empty="nominal values of the sensor file",
    fixed="the service calibration/load changes the calibration",
)
CALIBRATION_FOLDER: Final = Parameter(
    "calibration_folder",
    "~/.ros/posfet",
    "Folder in which the services calibration/load and calibration/save find and put their files, and nowhere else",
    fixed="it bounds what services may read and write",
)
MAX_RELATIVE: Final = Parameter(
    "max_relative_uncertainty",
    MAX_RELATIVE_UNCERTAINTY,
    "Standard deviation of the total force over that force above which data is not valid",
    low=1e-3,
    high=10.0,
    read_only=False,
)
CONTACT_THRESHOLD: Final = Parameter(
    "contact_threshold",
    0.0,
    "Least force of a taxel at which a contact begins; 0: as in the sensor file",
    unit="N",
    low=0.0,
    high=1000.0,
    read_only=False,
)
RELEASE_THRESHOLD: Final = Parameter(
    "release_threshold",
    0.0,
    "Force of a taxel below which a contact ends, at most contact_threshold; 0: the same share of it as in the sensor "
    "file",
    unit="N",
    low=0.0,
    high=1000.0,
    read_only=False,
)
HUM_REMOVAL: Final = Parameter(
    "hum_removal", True, "Estimate mains hum and subtract it from all signals", read_only=False
)
TOUCH_AT_START: Final = Parameter(
    "touch_at_start",
    False,
    "Something may touch the array when the model starts: data is not valid until a release, or a tare with `force`",
    read_only=False,
)
DISPLAY_RATE: Final = Parameter(
    "display_rate",
    30.0,
    "Rate of messages that are for display only: `view/image`, `view/contacts`, `view/truth`, `markers`",
    unit="Hz",
    low=0.1,
    high=10_000.0,
    read_only=False,
)
TUNING: Final = (CONTACT_THRESHOLD, RELEASE_THRESHOLD, TOUCH_AT_START, HUM_REMOVAL, DISPLAY_RATE)
"""Parameters of the model that may change while it runs, besides `max_relative_uncertainty`."""
DIRECT: Final = Parameter(
    "direct", False, "Receive scans within the process instead of subscribing to `raw`; set by composed bring-up"
)
SIMULATED: Final = Parameter("simulated", False, "Published in `info`: the signals come from a simulated board")

MODEL_NODE: Final = (
    *SENSOR,
    AUTOSTART,
    RELIABILITY,
    *MOUNT,
    CALIBRATION_FILE,
    CALIBRATION_FOLDER,
    MAX_RELATIVE,
    *TUNING,
    SIMULATED,
    Parameter(
        "contacts_as_bytes",
        True,
        "Serialise contacts in the node, which is faster; false: leave it to the middleware",
    ),
    DIRECT,
)


def default_frame(namespace: str) -> str:
    """Return the frame of the array where none is given, unique for each namespace.

    Parameters
    ----------
    namespace : str
        Full namespace of the nodes.

    Examples
    --------
    >>> default_frame("/hand/thumb")
    'hand_thumb_array'
    """
    return "_".join([*namespace.strip("/").split("/"), "array"]).lstrip("_")
