"""`posfet calibrate`: fit a calibration and write it to a file.

Of a real board, from a recording of its frames and the readings of a test stand that pressed a ball on each taxel; or
of a simulated one, which is pressed taxel by taxel.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from posfet_model.calibration.calibration_file import save_calibration
from posfet_model.calibration.least_squares_fit import fit
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.command_line import positive
from posfet_model.config import ConfigError
from posfet_model.parameters import SENSOR_FILE
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.calibration.bench_recording import COLUMNS, combine, read_reference, read_scans
from posfet_sim.calibration.simulated_bench import _now, calibrate
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.imperfections import load_imperfections
from posfet_sim.parameters import IMPERFECTIONS, SEED

BAD_INPUT = 1


def _at_the_bench(sensor: Sensor, options: argparse.Namespace) -> Calibration:
    """Return the calibration of the board that was recorded."""
    ball = Sphere(options.ball_radius * 1e-3, options.ball_modulus * 1e6)
    recording, late = combine(sensor, read_scans(options.recording, sensor), read_reference(options.reference), ball)
    print(f"{options.reference}: its clock is {late * 1e3:+.1f} ms late; {len(recording.time)} scans")
    return fit(sensor, recording, _now())


def main(words: Sequence[str] | None = None) -> int:
    """Write a calibration file; return 0, or 1 with one line on stderr for bad input."""
    options = _parser().parse_args(words)
    try:
        sensor = load_sensor(options.sensor)
        if (options.recording is None) != (options.reference is None):
            raise ConfigError("--recording and --reference go together")
        if options.recording is not None:
            calibration = _at_the_bench(sensor, options)
        else:
            imperfections = replace(load_imperfections(options.imperfections), resets_per_hour=0.0)
            calibration = calibrate(sensor, options.seed, imperfections)
        save_calibration(options.out, sensor, calibration)
    except (ConfigError, ValueError) as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    found = calibration.residuals
    if found is not None:
        print(
            f"{options.out}: {found.force_rms * 1e3:.2f} mN rms on what was held out, "
            f"{found.force_rms_before * 1e3:.2f} mN by the description alone"
        )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="posfet calibrate",
        description="Write the calibration of a board that was recorded while a test stand pressed a ball on each "
        "taxel, or of a simulated one, which is pressed now.",
    )
    parser.add_argument("out", metavar="FILE", type=Path, help="the YAML file to write")
    parser.add_argument("--recording", metavar="FILE", type=Path, help="of the board's frames, by posfet can record")
    parser.add_argument(
        "--reference", metavar="FILE", type=Path, help=f"readings of the stand, CSV: {','.join(COLUMNS)}"
    )
    parser.add_argument("--ball-radius", metavar="MM", type=positive, default=2.0, help="of the stand's ball [mm]")
    parser.add_argument(
        "--ball-modulus", metavar="MPA", type=positive, default=4.0, help="effective, of ball and cover together [MPa]"
    )
    parser.add_argument("--imperfections", default=IMPERFECTIONS.default, help=IMPERFECTIONS.help)
    parser.add_argument("--sensor", default=SENSOR_FILE.default, help=SENSOR_FILE.help)
    parser.add_argument(
        "--seed", type=int, default=1, help=f"{SEED.description}; bring-up uses {SEED.default} (default: 1)"
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
