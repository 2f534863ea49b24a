# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet record`: topics of a running stack into an MCAP file; `Recorder` starts and stops one from a program."""

from __future__ import annotations

import argparse
import math
import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Final

from rclpy.qos import QoSProfile

from posfet.number_text import counted
from posfet.raw_topics import COMMON, RawTopics, add_topic_options
from posfet_model.command_line import checked_namespace, positive
from posfet_model.config import ConfigError
from posfet_model.ros.exit_codes import exit_code
from posfet_model.ros.run_node import ros, spin
from posfet_sim.recording.mcap_file import DiskFull, MessageFile
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.recorded_scans import RAW
from posfet_sim.recording.ros2msg import short_name
from posfet_sim.recording.scan_gaps import ScanGaps

FLUSH_PERIOD: Final = 1.0
"""Period at which messages are written [s]: what the end of the process by force, or of the power, can take."""
SHOW_PERIOD: Final = 0.25
"""Period at which the progress is shown [s]."""
STOP_TIMEOUT: Final = 20.0
"""Time for a recording process to end [s]."""
WITH_INPUT: Final = "--end-with-input"
"""Option of a recording process that ends with its standard input, and so with the program that started it."""
PATIENCE: Final = 3.0
"""Time after the first message after which it is said what nobody publishes [s]: not first when all is recorded."""
FIRST_MESSAGE: Final = 10.0
"""Time to wait for the first message [s], and longer where the recording is to last longer: a busy machine takes some
seconds to find the topics."""


class RecorderNode(RawTopics):
    """Writes the messages of topics to a file as they arrive; of scans, only the sequence is read.

    Parameters
    ----------
    file : MessageFile
        Where to.
    namespaces : sequence of str
        Namespaces of the sensors, without slashes around them.
    topics : sequence of str
        Topics within each namespace, or full names with a slash at the front; none: all, and those of `COMMON`.
    **node_arguments : object
        Arguments of the node, as for `rclpy.node.Node`.
    """

    def __init__(
        self, file: MessageFile, namespaces: Sequence[str], topics: Sequence[str] = (), **node_arguments: Any
    ) -> None:
        self.file = file
        self.failure = ""
        """Why the recording ended, in one line; '' while it goes on."""
        self.begin: float | None = None
        """Monotonic time of the first message of a sensor or of a topic that was asked for [s]; None before it."""
        self.gaps: dict[str, ScanGaps] = {}
        """Scans missing in the recording, by topic."""
        super().__init__("posfet_record", namespaces, topics, **node_arguments)
        self.create_timer(FLUSH_PERIOD, self._flush)

    def opened(self, name: str, kind: str, offered: Sequence[QoSProfile]) -> Callable[[bytes, int], None]:
        """Add a topic to the file; return what writes its messages."""
        schema = schema_text(short_name(kind))
        topic = self.file.add_topic(name, short_name(kind), schema, _offered_text(offered))
        if short_name(kind) == RAW:
            self.gaps[name] = ScanGaps()
            return partial(self._write_scan, topic, self.gaps[name])
        return partial(self._write if name in COMMON and not self._wanted else self._write_and_begin, topic)

    def _write_scan(self, topic: int, gaps: ScanGaps, data: bytes, received: int) -> None:
        gaps.add(data)
        self._write_and_begin(topic, data, received)

    def _write_and_begin(self, topic: int, data: bytes, received: int) -> None:
        if self.begin is None:
            self.begin = time.monotonic()
        self._write(topic, data, received)

    def _write(self, topic: int, data: bytes, received: int) -> None:
        self._end_when_full(lambda: self.file.add(topic, received, data))

    def _flush(self) -> None:
        self._end_when_full(self.file.flush)

    def _end_when_full(self, write: Callable[[], object]) -> None:
        if self.failure:
            return
        try:
            write()
        except DiskFull as error:
            self.failure = str(error)


def _offered_text(offered: Sequence[Any]) -> str:
    """Return the offered profiles in the YAML of rosbag2 without its index, in which policies are numbers."""
    forever = "{sec: 9223372036, nsec: 854775807}"
    return "\n".join(
        f"- {{history: {int(each.history)}, depth: {each.depth}, reliability: {int(each.reliability)}, "
        f"durability: {int(each.durability)}, deadline: {forever}, lifespan: {forever}, "
        f"liveliness: {int(each.liveliness)}, liveliness_lease_duration: {forever}, "
        "avoid_ros_namespace_conventions: false}"
        for each in offered
    )


class Recorder:
    """A recording that a program starts and stops, in a process of its own: it takes no time from the caller's threads.

    A context manager starts it and stops it. It ends, and its file is whole, also when the program ends without `stop`,
    however that ends, or drops the recorder.

    Parameters
    ----------
    path : str or Path
        File to write; it must not exist.
    namespaces : sequence of str, optional
        Namespaces of the sensors; default: tactile.
    topics : sequence of str, optional
        Topics, as for `RecorderNode`; default: all.

    Examples
    --------
    >>> recorder = Recorder("grasp.mcap", topics=["raw", "info"])
    >>> recorder.start()  # doctest: +SKIP
    >>> recorder.stop()  # doctest: +SKIP
    'grasp.mcap: 12.0 s, 12034 messages of 2 topics, 1.4 MB; 0 scans missing'
    """

    def __init__(self, path: str | Path, namespaces: Sequence[str] = ("tactile",), topics: Sequence[str] = ()) -> None:
        self.path = Path(path)
        self._words = [str(self.path), "--namespace", *namespaces, *(["--topics", *topics] if topics else [])]
        self._process: subprocess.Popen[str] | None = None
        self._dropped: weakref.finalize[..., Recorder] | None = None

    def __enter__(self) -> Recorder:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if self._process is None:
            return
        with suppress(*((ConfigError,) if kind else ())):  # the first error counts
            self.stop()

    def start(self) -> None:
        """Begin to record; ConfigError, one line, if the file exists or a recording is running already."""
        if self.running:
            raise ConfigError(f"{self.path}: is being recorded already")
        if self.path.exists():
            raise ConfigError(f"{self.path}: cannot be written: File exists; choose another name, or remove it")
        command = [sys.executable, "-m", "posfet.record", WITH_INPUT, *self._words]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, start_new_session=True
        )
        self._dropped = weakref.finalize(self, _end, self._process)

    @property
    def running(self) -> bool:
        """Whether the recording goes on; false also after it has ended by itself, as on a full disk."""
        return self._process is not None and self._process.poll() is None

    def stop(self) -> str:
        """End the recording and return its summary in one line; ConfigError, one line, if it failed or never began."""
        process, self._process = self._process, None
        if process is None:
            raise ConfigError(f"{self.path}: is not being recorded")
        if self._dropped is not None:
            self._dropped.detach()
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            output, errors = process.communicate(timeout=STOP_TIMEOUT)
        except subprocess.TimeoutExpired as error:
            process.kill()
            process.communicate()
            raise ConfigError(
                f"{self.path}: the recorder did not end; posfet replay reads what the file has"
            ) from error
        if process.returncode:
            raise ConfigError(errors.strip().splitlines()[-1] if errors.strip() else f"{self.path}: recording failed")
        return output.strip()


def _end(process: subprocess.Popen[str]) -> None:
    """Let a recording process end, by the end of its standard input; what it says is lost."""
    with suppress(subprocess.TimeoutExpired):
        process.communicate(timeout=STOP_TIMEOUT)


def _end_of_input() -> threading.Event:
    """Return an event that is set at the end of the standard input."""
    ended = threading.Event()

    def wait() -> None:
        while os.read(0, 4096):
            pass
        ended.set()

    threading.Thread(target=wait, daemon=True).start()
    return ended


def main(words: Sequence[str] | None = None) -> int:
    """Record until Ctrl-C or for the time given.

    Parameters
    ----------
    words : sequence of str, optional
        Command line; default: that of the process.

    Returns
    -------
    int
        0; 1, with one line on stderr, for bad input, on a full disk, or if no message arrived.
    """
    options = make_parser().parse_args(words)
    path = options.file or Path(time.strftime("posfet_%Y-%m-%d_%H-%M-%S.mcap"))
    return exit_code(lambda: _record(path, options))


def _record(path: Path, options: argparse.Namespace) -> int:
    if path.suffix != ".mcap":
        raise ConfigError(f"{path}: must end in .mcap")
    namespaces = [checked_namespace(name) for name in options.namespace]
    ended = _end_of_input() if options.end_with_input else threading.Event()
    file = MessageFile(path, "posfet record")
    try:
        with ros([]) as stack:
            node = RecorderNode(file, namespaces, options.topics)
            stack.callback(node.destroy_node)
            begin = time.monotonic()
            patience = begin + max(options.seconds, FIRST_MESSAGE)
            told = False
            with _Display(path, node) as display:

                def over() -> bool:
                    nonlocal told
                    now = time.monotonic()
                    display.update(now)
                    if not told and node.begin is not None and now >= node.begin + PATIENCE:
                        told = True
                        for name in node.missing:
                            display.say(f"{name}: nobody publishes it so far")
                    end = patience if node.begin is None else node.begin + options.seconds
                    full = bool(node.failure) or file.size >= options.max_size * 1e6
                    return now >= end or full or ended.is_set()

                spin([node], until=over)
            node.read()
            spent = time.monotonic() - (node.begin or begin)
            if node.failure:
                raise ConfigError(node.failure)
    finally:
        file.close()
    if not file.messages or set(node.subscribed) <= set(COMMON) - set(options.topics):
        path.unlink()
        wanted = ", ".join(node.missing) or ", ".join(f"/{name}/..." for name in namespaces)
        raise ConfigError(f"no message on {wanted}: start the stack with posfet bringup, or give its --namespace")
    for name in node.missing:
        print(f"{name}: nobody published it", file=sys.stderr)
    topics = counted(len(node.subscribed), "topic")
    missing = _missing(node.gaps)
    print(f"{path}: {spent:.1f} s, {file.messages} messages of {topics}, {file.size / 1e6:.1f} MB{missing}")
    return 0


def _missing(gaps: Mapping[str, ScanGaps]) -> str:
    """Return how many scans are missing, for the end of the summary; of each sensor where there are several."""
    found = [(f" of {name}" if len(gaps) > 1 else "", each.missing) for name, each in sorted(gaps.items())]
    return "".join(f"; {counted(number, 'scan')}{which} missing" for which, number in found)


class _Display:
    """One line with the progress, on a terminal only."""

    def __init__(self, path: Path, node: RecorderNode) -> None:
        self._path, self._node = path, node
        self._status: Any = None
        self._next = 0.0

    def __enter__(self) -> _Display:
        if sys.stderr.isatty():
            from rich.console import Console  # noqa: PLC0415  only a terminal needs it

            self._status = Console(stderr=True).status("").__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        if self._status:
            self._status.__exit__(*error)

    def say(self, text: str) -> None:
        """Print a line, above the progress where it is shown."""
        if self._status:
            self._status.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=sys.stderr, flush=True)

    def update(self, now: float) -> None:
        """Show the progress if it is due."""
        if self._status and now >= self._next:
            from rich.markup import escape  # noqa: PLC0415

            self._next = now + SHOW_PERIOD
            file, node = self._node.file, self._node
            spent = now - (node.begin or now)
            self._status.update(
                f"{escape(str(self._path))}: {spent:.0f} s, {file.messages} messages of "
                f"{len(node.subscribed)} topics, {file.size / 1e6:.1f} MB; Ctrl-C ends it"
            )


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet record`."""
    parser = argparse.ArgumentParser(
        prog="posfet record",
        description="Record topics of a running stack to an MCAP file, which posfet replay, posfet export, rosbag2, "
        "Foxglove and PlotJuggler read.",
    )
    parser.add_argument(
        "file", metavar="FILE", nargs="?", type=Path, help="file to write (default: posfet_<date and time>.mcap)"
    )
    add_topic_options(parser, "raw info", "; raw and info are enough to replay")
    parser.add_argument(
        "--for", dest="seconds", type=positive, default=math.inf, help="stop so many seconds after the first message"
    )
    parser.add_argument("--max-size", type=positive, default=math.inf, metavar="MB", help="stop at this size [MB]")
    parser.add_argument(WITH_INPUT, action="store_true", help=argparse.SUPPRESS)
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
