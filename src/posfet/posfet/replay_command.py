# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet replay`: a recording through the model again, live, or as fast as possible into a file."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.command_line import BAD_INPUT, checked_namespace, positive
from posfet_model.config import ConfigError
from posfet_model.parameters import (
    CALIBRATION_FILE,
    DISPLAY_RATE,
    FRAME_ID,
    MAX_RELATIVE,
    SENSOR_FILE,
    SERIAL,
    TUNING,
    Parameter,
    Scalar,
    default_frame,
)
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.model_settings import reconstruction_settings
from posfet_model.sensor.description import load_sensor, with_serial
from posfet_sim.commands.progress import progress
from posfet_sim.parameters import REPLAY_TOPIC
from posfet_sim.recording.cdr import serialise
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.recording.mcap_reader import Message
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.recorded_scans import INFO, RecordedScans
from posfet_sim.recording.scan_messages import TRUTH

CONTACTS: Final = "posfet_msgs/TactileContacts"
IMAGE: Final = "posfet_msgs/TactileImage"
NAMESPACE: Final = Parameter("namespace", "tactile", "Namespace of the topics in the file")
_OF_MODEL: Final = tuple(each for each in TUNING if each is not DISPLAY_RATE)
TO_FILE: Final = (NAMESPACE, SENSOR_FILE, SERIAL, CALIBRATION_FILE, FRAME_ID, MAX_RELATIVE, *_OF_MODEL, REPLAY_TOPIC)
"""Arguments of a replay into a file."""


def main(words: Sequence[str] | None = None) -> int:
    """Replay a recording.

    Parameters
    ----------
    words : sequence of str, optional
        Command line; default: that of the process.

    Returns
    -------
    int
        0 after a replay; 1, with one line on stderr, for bad input; otherwise as `posfet bringup`.
    """
    words = sys.argv[1:] if words is None else words
    options, rest = make_parser().parse_known_args(words)
    if options.out is None:
        rate = 0.0 if options.fast else options.rate
        given = ["source:=replay", f"replay_file:={options.recording}", f"replay_rate:={rate}"]
        from posfet.bringup import main as bringup  # noqa: PLC0415  # a replay into a file needs no ROS

        return bringup([*given, *rest])
    try:
        print(to_file(options.recording, options.out, arguments(rest)))
    except ConfigError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    return 0


def arguments(words: Sequence[str]) -> dict[str, Scalar]:
    """Return the arguments of a replay into a file by name; ConfigError, one line, for one that is not allowed.

    Parameters
    ----------
    words : sequence of str
        Words `name:=value`.
    """
    known = {argument.name: argument for argument in TO_FILE}
    given: dict[str, Scalar] = {}
    for word in words:
        name, separator, text = word.partition(":=")
        if not separator or name not in known:
            raise ConfigError(f"{word}: with --out an argument must be name:=value of {', '.join(known)}")
        if name in given:
            raise ConfigError(f"{name}: is given twice")
        try:
            given[name] = known[name].parse(text)
        except ValueError as error:
            raise ConfigError(f"{name}: {error}") from error
    return {name: _default(argument) for name, argument in known.items()} | given


def _default(argument: Parameter) -> Scalar:
    if isinstance(argument.default, list):
        raise TypeError(argument.name)
    return argument.default


def to_file(recording: Path, out: Path, values: dict[str, Any]) -> str:
    """Process the scans of a recording as fast as possible, write a file, and return a summary in one line.

    The file has the topics `contacts` and `image`, and those of the recording with the description of this array and
    its ground truth.

    Parameters
    ----------
    recording : Path
        The recording.
    out : Path
        File to write; it must not exist.
    values : dict of str to Any
        Every argument of `TO_FILE` by name.

    Raises
    ------
    ConfigError
        A file or argument cannot be used; one line.
    """
    sensor = with_serial(load_sensor(values["sensor_file"]), values["serial"])
    path = values[CALIBRATION_FILE.name]
    calibration = load_calibration(path, sensor) if path else None
    settings = reconstruction_settings(sensor, values)
    model = Reconstructor(sensor, calibration, settings)
    namespace = checked_namespace(values["namespace"])
    frame_id = values["frame_id"] or default_frame(namespace)
    source = RecordedScans(recording, sensor, values[REPLAY_TOPIC.name])
    layout = sensor.layout
    contacts_bytes = ContactsBytes(sensor, frame_id)
    begin, scans, tracks = time.perf_counter(), 0, set[int]()
    schemas = {name: schema_text(name) for name in (CONTACTS, IMAGE)}
    file = MessageFile(out, "posfet replay")
    try:
        contacts_topic = file.add_topic(f"/{namespace}/contacts", CONTACTS, schemas[CONTACTS])
        image_topic = file.add_topic(f"/{namespace}/image", IMAGE, schemas[IMAGE])
        kept: dict[str, int] = {}

        def keep(message: Message) -> None:
            topic = message.topic
            readable = topic.encoding == "cdr" and topic.schema_encoding == "ros2msg"
            if topic.type in {INFO, TRUTH} and readable and source.of_sensor(topic):
                if topic.name not in kept:
                    kept[topic.name] = file.add_topic(topic.name, topic.type, topic.schema)
                file.add(kept[topic.name], message.time, message.data)

        with progress(recording.name, source.recording.size) as at:
            for scan in source.scans(keep, at):
                scans += 1
                result = model.process(scan)
                if result.accepted or result.unusable:
                    image = model.image()
                    file.add(contacts_topic, result.stamp, contacts_bytes.fill(result), result.sequence)
                    seconds, nanoseconds = divmod(result.stamp, 1_000_000_000)
                    message = {
                        "header": {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id},
                        "layout_id": layout.id,
                        "sequence": result.sequence,
                        "rows": layout.rows,
                        "cols": layout.cols,
                        "force": image.force,
                        "standard_deviation": image.standard_deviation,
                        "status": image.status,
                        "total_force": image.total,
                        "total_force_standard_deviation": image.total_standard_deviation,
                        "data_valid": result.valid,
                    }
                    file.add(image_topic, result.stamp, serialise(IMAGE, message), result.sequence)
                    tracks.update(contact.id for contact in result.contacts)
                if model.maintenance_due:
                    model.run_maintenance()
    finally:
        file.close()
    if source.problem:
        print(source.problem, file=sys.stderr)
    spent = time.perf_counter() - begin
    recorded = (source.overview.end - source.overview.begin) * 1e-9
    return (
        f"{out}: {scans} scans, {len(tracks)} contact{'s' * (len(tracks) != 1)}; {recorded:.1f} s in {spent:.1f} s, "
        f"{recorded / max(spent, 1e-9):.1f} times real time"
    )


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet replay`."""
    parser = argparse.ArgumentParser(
        prog="posfet replay",
        description="Run the raw scans of a recording through the model again: live, with /clock, or into a file.",
        epilog="Further arguments are name:=value. Live, those of posfet bringup that go with source:=replay (posfet "
        "bringup -s), such as calibration_file:=thumb_calibration.yaml; thresholds and other node parameters are in a "
        "params_file. With "
        f"--out: {', '.join(argument.name for argument in TO_FILE)}.",
    )
    parser.add_argument(
        "recording", metavar="RECORDING", type=Path, help="an MCAP file of posfet record, posfet sim or ros2 bag"
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        help="write contacts and images to this MCAP file, as fast as possible and without ROS",
    )
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument("--rate", type=positive, default=1.0, help="playback speed factor (default: 1, real time)")
    pace.add_argument("--fast", action="store_true", help="publish as fast as possible")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
