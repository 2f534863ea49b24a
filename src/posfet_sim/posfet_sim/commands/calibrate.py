# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet calibrate`: fit a calibration and write it to a file.

The calibration of a real board is fitted to a recording of its frames and the readings of a calibration rig that
pressed a ball on each taxel; that of a simulated board to a simulated rig.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from posfet_model.calibration.calibration_file import check_replaceable, check_writable, save_calibration
from posfet_model.calibration.least_squares_fit import fit
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.command_line import BAD_INPUT, positive
from posfet_model.config import ConfigError
from posfet_model.parameters import SENSOR_FILE, SERIAL
from posfet_model.sensor.description import Sensor, load_sensor, with_serial
from posfet_sim.calibration.bench_recording import COLUMNS, combine, read_reference, read_scans
from posfet_sim.calibration.report import summary, write_report
from posfet_sim.calibration.simulated_bench import calibrate, timestamp
from posfet_sim.commands.options import add_error_model, add_seed, add_sensor, add_serial
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import load_error_model


def _from_recording(sensor: Sensor, options: argparse.Namespace) -> Calibration:
    """Return the calibration of the recorded board."""
    ball = Sphere(options.ball_radius * 1e-3, options.ball_modulus * 1e6)
    scans = read_scans(options.recording, sensor)
    if scans.problem:
        print(scans.problem, file=sys.stderr)
    recording, late = combine(sensor, scans, read_reference(options.reference), ball)
    print(f"{options.reference}: clock delay {late * 1e3:+.1f} ms; {len(recording.time)} scans")
    return fit(sensor, recording, timestamp())


def _guide(sensor: Sensor, options: argparse.Namespace) -> None:
    """Go through the steps on a real board; afterwards the options name the recording."""
    from posfet_sim.commands import guided  # noqa: PLC0415  # needs python-can

    if options.recording is not None:
        raise ConfigError("--recording: --guided records by itself; leave it out")
    if not options.interface:
        raise ConfigError("--guided: needs the board: -i INTERFACE -c CHANNEL; posfet can list shows them")
    options.recording = options.out.with_suffix(".mcap")
    with guided.scans_of(sensor, options.interface, options.channel) as scans:
        guide = guided.run(sensor, scans, options.recording, options.reference)
    for step in guide.skipped:
        print(f"{step.title}: left out" + (f": {step.optional}" if step.optional else ""))
    if options.reference is None:
        print(f"{options.recording}: recorded. With the file of the rig: {_fit_command(options)}")


def _fit_command(options: argparse.Namespace) -> str:
    """Return the command that fits a recording of `--guided` later, with what was given."""
    words = ["posfet", "calibrate", str(options.out), "--recording", str(options.recording), "--reference", "FILE"]
    words += ["--ball-radius", f"{options.ball_radius:g}", "--ball-modulus", f"{options.ball_modulus:g}"]
    for option, parameter, value in (
        ("--sensor", SENSOR_FILE, options.sensor),
        ("--serial", SERIAL, options.serial),
    ):
        if value != parameter.default:
            words += [option, value]
    words += ["--report", str(options.report or options.out.with_suffix(".html"))]
    return shlex.join(words)


def main(words: Sequence[str] | None = None) -> int:
    """Write a calibration file; return 0, or 1 with one line on stderr for bad input."""
    options = make_parser().parse_args(words)
    try:
        sensor = with_serial(load_sensor(options.sensor), options.serial)
        for path in (options.out, options.report):
            if path is not None:
                check_writable(path)
        check_replaceable(options.out, sensor)
        if options.guided:
            _guide(sensor, options)
            if options.reference is None:
                return 0
        if (options.recording is None) != (options.reference is None):
            raise ConfigError("--recording and --reference are only valid together")
        if options.recording is not None:
            calibration = _from_recording(sensor, options)
        else:
            error_model = replace(load_error_model(options.imperfections), resets_per_hour=0.0)
            calibration = calibrate(sensor, options.seed, error_model)
        save_calibration(options.out, sensor, calibration)
        if options.report is not None:
            write_report(options.report, sensor, calibration)
    except (ConfigError, ValueError) as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    print(f"{options.out}: written; ± is followed by a standard deviation")
    print("\n".join(f"  {line}" for line in summary(calibration)))
    return 0


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet calibrate`."""
    parser = argparse.ArgumentParser(
        prog="posfet calibrate",
        description="Fit the calibration of a board from a recording on a calibration rig that pressed a ball on each "
        "taxel, or of a simulated board on a simulated rig.",
    )
    parser.add_argument(
        "out",
        metavar="FILE",
        type=Path,
        help="the YAML file to write; one that exists must be a calibration of the sensor",
    )
    parser.add_argument(
        "--recording",
        metavar="FILE",
        type=Path,
        help="recorded frames of the board (posfet can record), or its raw scans (posfet record)",
    )
    parser.add_argument("--reference", metavar="FILE", type=Path, help=f"readings of the rig, CSV: {','.join(COLUMNS)}")
    parser.add_argument(
        "--ball-radius", metavar="MM", type=positive, default=2.0, help="radius of the ball [mm] (default: 2)"
    )
    parser.add_argument(
        "--ball-modulus",
        metavar="MPA",
        type=positive,
        default=4.0,
        help="effective modulus of ball and elastomer skin [MPa] (default: 4)",
    )
    parser.add_argument(
        "--report", metavar="FILE", type=Path, help="also write a report: numbers, maps and residuals, one HTML file"
    )
    parser.add_argument(
        "--guided", action="store_true", help="go through the steps on the rig with live values, and record the board"
    )
    parser.add_argument(
        "-i", "--interface", default="", help="with --guided: interface of python-can, such as socketcan"
    )
    parser.add_argument("-c", "--channel", default="", help="with --guided: its channel, such as can0")
    add_sensor(parser)
    add_serial(parser)
    add_error_model(parser)
    add_seed(parser, default=1)
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
