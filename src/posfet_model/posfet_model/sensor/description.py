# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The sensor file: layout, device, amplifier, ADC and CAN link of one sensor, for driver, simulation and model.

The file uses practical units, named in each key; the dataclasses are in SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.config import ConfigError, Section, find_file, read_yaml
from posfet_model.device import adc as converter
from posfet_model.device.constants import VACUUM_PERMITTIVITY
from posfet_model.sensor.defaults import DEFAULT_SENSOR, FRAME_CHOICES

if TYPE_CHECKING:
    from posfet_model.sensor.frame_mapping import FrameMapping

SENSOR_FOLDER = Path(__file__).parent / "sensors"
"""Folder of the sensor files that come with the package."""

OWN_PROTOCOL: Final = "posfet"
"""Value of `protocol` for boards with the protocol of this project; also the default."""
MAX_SIDE = 128
"""Largest number of rows and of columns."""
MIN_SPAN = 1e-3
"""Smallest span of the amplifier's rails and of the ADC [V]."""
COARSEST_BITS = 12
"""Bits of a count sent over classic CAN: the coarsest resolution that a count can have."""
SATURATION_SIGMAS = 4.0
"""Margin between an unsaturated voltage and the end of the range, in standard deviations of the noise."""


@dataclass(frozen=True)
class Layout:
    """Positions of the taxels. Frame: x along columns, y along rows, z outward, origin in the middle of the array.

    On a bent chip x and y are arc lengths along the surface.
    """

    id: int
    rows: int
    cols: int
    pitch_x: float
    """Distance between columns [m]."""
    pitch_y: float
    """Distance between rows [m]."""
    taxel_area: float
    """Area of a taxel that is sensitive to force [m2]."""
    bend_radius: float = math.inf
    """Radius of the cylinder to which the chip is bent, the array on its outer side [m]; inf: flat."""
    bend_axis: str = "x"
    """Direction of the cylinder's axis, x or y."""

    @property
    def taxels(self) -> int:
        """Number of taxels."""
        return self.rows * self.cols

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """Centres of the taxels [m], shape [rows * cols, 2] (x, y), row by row; read-only."""
        x = (np.arange(self.cols) - (self.cols - 1) / 2) * self.pitch_x
        y = (np.arange(self.rows) - (self.rows - 1) / 2) * self.pitch_y
        positions = np.stack([np.tile(x, self.rows), np.repeat(y, self.cols)], axis=1)
        positions.flags.writeable = False
        return positions


@dataclass(frozen=True)
class Device:
    """The piezoelectric film on the gate, its leakage, thermal lag and elastomer skin."""

    piezoelectric_coefficient: float
    """d33 [C/N]; negative for PVDF: compression (negative stress) gives positive charge."""
    pyroelectric_coefficient: float
    """p [C/(m2 K)]."""
    film_thickness: float
    """Thickness of the film [m]."""
    relative_permittivity: float
    """Relative permittivity of the film [1]."""
    leak_time_constant: float
    """Time constant tau of the charge leakage through the bias resistor [s]."""
    thermal_time_constant: float
    """Lag of the film's temperature behind the chip's sensors [s]."""
    force_max: float
    """Maximum force on a taxel for which the sensor is specified [N]."""
    contact_spread: float
    """Standard deviation of the Gaussian spread of pressure by the elastomer skin [m]."""

    @property
    def film_capacitance(self) -> float:
        """Capacitance of the film per area Cpvdf [F/m2]; charge sigma shifts the gate of the stack by sigma/Cpvdf."""
        return VACUUM_PERMITTIVITY * self.relative_permittivity / self.film_thickness


@dataclass(frozen=True)
class Amplifier:
    """The unity-gain follower of each taxel."""

    open_loop_gain: float
    """A0 [V/V]."""
    gain_bandwidth: float
    """Gain-bandwidth product [Hz]."""
    offset: float
    """Input offset voltage [V]."""
    rail_low: float
    """Lowest output voltage [V]."""
    rail_high: float
    """Highest output voltage [V]."""

    @property
    def follower_gain(self) -> float:
        """Static gain of the follower A0 / (1 + A0) [1]."""
        return self.open_loop_gain / (1.0 + self.open_loop_gain)


@dataclass(frozen=True)
class Adc:
    """The ADC of the readout board."""

    bits: int
    low: float
    """Voltage of code 0 [V]."""
    high: float
    """Voltage of the highest code [V]."""
    noise: float
    """RMS noise at the ADC's input, amplifier included [V]."""


@dataclass(frozen=True)
class CanLink:
    """The CAN link of the readout board."""

    fd: bool
    """Whether scans are sent in CAN FD frames; else in classic CAN frames."""
    bitrate: int
    """Nominal bitrate [bit/s]."""
    data_bitrate: int
    """Bitrate of the CAN FD data phase [bit/s]."""
    base_id: int
    """First of the board's CAN identifiers (11 bit); 0 for a board with frames of its own."""
    scan_rate: float
    """Nominal scans per second [Hz]."""


@dataclass(frozen=True)
class ContactThresholds:
    """Contact threshold of a taxel, with hysteresis."""

    threshold: float
    """Onset threshold: a taxel enters a contact at this force [N]."""
    deadband: float
    """Hysteresis: the release threshold is this much below the onset threshold [N]."""


@dataclass(frozen=True)
class Sensor:
    """One sensor, as described by its file."""

    name: str
    serial: str
    layout: Layout
    device: Device
    amplifier: Amplifier
    adc: Adc
    can: CanLink
    contact: ContactThresholds
    mapping: FrameMapping | None = None
    """Frames of a board with another protocol; None: the protocol of this project."""

    @property
    def volts_per_newton(self) -> float:
        """Sensitivity: change of the follower's output per force on a taxel, before leakage [V/N]."""
        charge = -self.device.piezoelectric_coefficient / self.layout.taxel_area
        return charge / self.device.film_capacitance * self.amplifier.follower_gain

    @property
    def rest(self) -> float:
        """Output of the follower without a force: its offset [V]."""
        return self.amplifier.offset * self.amplifier.follower_gain

    @property
    def saturation_margin(self) -> float:
        """Distance from the ends of ADC and amplifier within which a voltage may have been clipped [V]."""
        coarsest = converter.lsb(min(COARSEST_BITS, self.adc.bits), self.adc.low, self.adc.high)
        return SATURATION_SIGMAS * self.adc.noise + coarsest


def load_sensor(name: str | Path = DEFAULT_SENSOR) -> Sensor:
    """Return the sensor described by a YAML file.

    Parameters
    ----------
    name : str or Path, default "posfet_5x5"
        Path of the file, or the bare name of one that comes with the package.

    Returns
    -------
    Sensor
        The sensor in SI units.

    Raises
    ------
    ConfigError
        A key is missing, unknown or repeated, or a value has the wrong type, is NaN or out of range; one line that
        names file, key, allowed range and value.
    """
    top = read_yaml(find_file(str(name), SENSOR_FOLDER, "sensor"))
    title, serial = top.text("name"), top.text("serial")
    layout = _layout(top.section("layout"))
    mapping = _mapping(top, layout)
    sensor = Sensor(
        name=title,
        serial=serial,
        layout=layout,
        device=_device(top.section("device")),
        amplifier=_amplifier(top.section("amplifier")),
        adc=_adc(top.section("adc")),
        can=_can(top.section("can"), own_frames=mapping is None),
        contact=_contact(top.section("contact")),
        mapping=mapping,
    )
    top.end()
    highest = min(sensor.adc.high, sensor.amplifier.rail_high) - sensor.rest
    if highest <= 0:
        raise top.error("amplifier.rail_high_V", "rail_high_V and adc.high_V must be above 0 and the offset")
    if sensor.device.force_max * sensor.volts_per_newton > highest:
        limit = highest / sensor.volts_per_newton
        raise top.error(
            "device.force_max_N",
            f"must be in (0, {limit:.4g}] for this amplifier and ADC, got {sensor.device.force_max:g}",
        )
    _check_rest(sensor, top)
    return sensor


def with_frames(sensor: Sensor, fd: str) -> Sensor:
    """Return `sensor` with the type of CAN frames that its board is configured to send.

    Classic CAN frames carry only 12 bits of each count, which lowers the resolution of the force.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.
    fd : str
        One of `FRAME_CHOICES`.

    Returns
    -------
    Sensor
        The sensor with that type of frames.
    """
    if fd == "auto":
        return sensor
    return replace(sensor, can=replace(sensor.can, fd=fd == "true"))


def with_serial(sensor: Sensor, serial: str) -> Sensor:
    """Return `sensor` as the individual with a serial number: sensors of one kind share a sensor file.

    Parameters
    ----------
    sensor : Sensor
        The sensor file.
    serial : str
        Serial number; '': that of the sensor file.
    """
    return replace(sensor, serial=serial) if serial else sensor


def _check_rest(sensor: Sensor, top: Section) -> None:
    """Raise ConfigError unless the signal at rest is inside the range of amplifier and ADC, unclipped."""
    amplifier, adc = sensor.amplifier, sensor.adc
    noise = SATURATION_SIGMAS * adc.noise
    # One count more, so that the range holds a count however the counts lie.
    margin = sensor.saturation_margin + converter.lsb(16, adc.low, adc.high)
    low = "adc.low_V" if adc.low >= amplifier.rail_low else "amplifier.rail_low_V"
    high = "adc.high_V" if adc.high <= amplifier.rail_high else "amplifier.rail_high_V"
    for key, inside in (
        (low, sensor.rest - max(amplifier.rail_low, adc.low)),
        (high, min(amplifier.rail_high, adc.high) - sensor.rest),
    ):
        if inside <= margin:
            noisy = inside > margin - noise
            raise top.error(
                "adc.noise_mV" if noisy else key,
                f"must leave more than {margin:.3g} V ({SATURATION_SIGMAS:g} standard deviations of the noise and a "
                f"step of the ADC) between {key} and the signal at rest, amplifier.offset_mV = "
                f"{amplifier.offset * 1e3:g}, got "
                f"{inside:.3g} V: {'lower the noise' if noisy else 'widen the range'}",
            )


def _mapping(top: Section, layout: Layout) -> FrameMapping | None:
    """Return the mapping of a board with frames of its own, None for one with the protocol of this project."""
    if not top.is_mapping("protocol"):
        top.text("protocol", (OWN_PROTOCOL,), default=OWN_PROTOCOL)
        return None
    from posfet_model.sensor.frame_mapping import read_mapping  # noqa: PLC0415  # for few boards

    return read_mapping(top.section("protocol"), layout.rows, layout.cols)


def _layout(section: Section) -> Layout:
    layout = Layout(
        id=section.whole("id", 1, 0xFFFF),
        rows=section.whole("rows", 1, MAX_SIDE),
        cols=section.whole("cols", 1, MAX_SIDE),
        pitch_x=section.number("pitch_x_mm", 0.01, 100) * 1e-3,
        pitch_y=section.number("pitch_y_mm", 0.01, 100) * 1e-3,
        taxel_area=section.number("taxel_area_mm2", 1e-4, 1e4) * 1e-6,
    )
    if "bend_radius_mm" in section:
        axis = section.text("bend_axis", ("x", "y"))
        span = layout.rows * layout.pitch_y if axis == "x" else layout.cols * layout.pitch_x
        least = math.ceil(max(span / math.pi, 1e-3) * 1e5) / 100
        layout = replace(layout, bend_radius=section.number("bend_radius_mm", least, 1e5) * 1e-3, bend_axis=axis)
    section.end()
    if layout.taxel_area > layout.pitch_x * layout.pitch_y * (1 + 1e-9):
        cell = layout.pitch_x * layout.pitch_y * 1e6
        raise section.error(
            "taxel_area_mm2", f"must be in (0, {cell:g}], the cell of one taxel, got {layout.taxel_area * 1e6:g}"
        )
    return layout


def _device(section: Section) -> Device:
    device = Device(
        piezoelectric_coefficient=section.number("piezoelectric_coefficient_pC_per_N", -1000, -0.1) * 1e-12,
        pyroelectric_coefficient=section.number("pyroelectric_coefficient_uC_per_m2K", -1000, 1000) * 1e-6,
        film_thickness=section.number("film_thickness_um", 0.01, 1000) * 1e-6,
        relative_permittivity=section.number("relative_permittivity", 1, 1000),
        leak_time_constant=section.number("leak_time_constant_s", 1e-3, 1e9),
        thermal_time_constant=section.number("thermal_time_constant_s", 0, 1e4),
        force_max=section.number("force_max_N", 0, 1e4, exclusive=True),
        contact_spread=section.number("contact_spread_mm", 0, 100) * 1e-3,
    )
    section.end()
    return device


def _amplifier(section: Section) -> Amplifier:
    amplifier = Amplifier(
        open_loop_gain=10 ** (section.number("open_loop_gain_dB", 0, 200) / 20),
        gain_bandwidth=section.number("gain_bandwidth_MHz", 1e-6, 1e4) * 1e6,
        offset=section.number("offset_mV", -1000, 1000) * 1e-3,
        rail_low=section.number("rail_low_V", -100, 100),
        rail_high=section.number("rail_high_V", -100, 100),
    )
    section.end()
    if amplifier.rail_high - amplifier.rail_low < MIN_SPAN:
        raise section.error(
            "rail_low_V", f"must be below rail_high_V = {amplifier.rail_high:g}, got {amplifier.rail_low:g}"
        )
    return amplifier


def _adc(section: Section) -> Adc:
    adc = Adc(
        bits=section.whole("bits", 8, 16),
        low=section.number("low_V", -100, 100),
        high=section.number("high_V", -100, 100),
        noise=section.number("noise_mV", 0, 1000) * 1e-3,
    )
    section.end()
    if adc.high - adc.low < MIN_SPAN:
        raise section.error("low_V", f"must be at least {MIN_SPAN:g} below high_V = {adc.high:g}, got {adc.low:g}")
    return adc


def _can(section: Section, own_frames: bool) -> CanLink:
    link = CanLink(
        fd=section.flag("fd"),
        bitrate=section.whole("bitrate_kbit_per_s", 10, 1000) * 1000,
        data_bitrate=section.whole("data_bitrate_kbit_per_s", 10, 8000) * 1000,
        base_id=section.whole("base_id", 0, 0x7F0) if own_frames else 0,  # else the DBC file holds the identifiers
        scan_rate=section.number("scan_rate_Hz", 0.1, 20_000),
    )
    section.end()
    return link


def _contact(section: Section) -> ContactThresholds:
    threshold = section.number("threshold_mN", 0, 1e6, exclusive=True)
    thresholds = ContactThresholds(threshold * 1e-3, section.number("deadband_mN", 0, threshold) * 1e-3)
    section.end()
    return thresholds


__all__ = [
    "DEFAULT_SENSOR",
    "FRAME_CHOICES",
    "Adc",
    "Amplifier",
    "CanLink",
    "ConfigError",
    "ContactThresholds",
    "Device",
    "Layout",
    "Sensor",
    "load_sensor",
    "with_frames",
]
