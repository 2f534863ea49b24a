# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lower bound given by machine and middleware: `python -m benchmarks.latency.processes.echo LINK SENSOR OUT`.

A process that replaces the stack: it only reads the terminal and publishes a message without contacts for each scan,
with its sequence.
"""

from __future__ import annotations

import os
import select
import sys
import threading
from binascii import unhexlify
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node

from benchmarks.latency.processes.recording import TimeLog
from posfet_driver.board.board_client import Board
from posfet_driver.bus.slcan_bus import READ_SIZE, SlcanBus
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.run_node import ros, spin
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_msgs.msg import TactileContacts

SEQUENCE = slice(5, 9)
"""Position of the low 16 bits of the sequence in the line of a CAN FD frame."""
START_TIMEOUT = 5.0
WAIT_MS = 100


def empty_message(sensor: Sensor) -> Callable[[int], bytes]:
    """Return what serialises the message without contacts of a sequence; the next call overwrites it."""
    message, result = ContactsBytes(sensor, "finger"), Reconstruction(True, False, 0, 0, True, (), {}, 0)

    def filled(sequence: int) -> bytes:
        result.sequence = sequence
        return message.fill(result)

    return filled


def started_bus(link: str, sensor: Sensor) -> tuple[Board, SlcanBus]:
    """Return a board behind an adapter, from which a first scan was received, and its bus."""
    bus = SlcanBus(link, sensor.can.bitrate, sensor.can.data_bitrate, fd=True)
    board = Board(sensor, lambda: bus)
    board.open()
    while board.read(START_TIMEOUT) is None:
        pass
    return board, bus


def echo(port: int, node: Node, message: Callable[[int], bytes], times: TimeLog, end: threading.Event) -> None:
    """Publish a message for each line read from `port`."""
    publisher = node.create_publisher(TactileContacts, "contacts", 10)
    poll = select.poll()
    poll.register(port, select.POLLIN)
    while not end.is_set():
        if poll.poll(WAIT_MS):
            for line in os.read(port, READ_SIZE).split(b"\r")[:-1]:
                if line[:1] == b"b":  # otherwise a status frame
                    sequence = int.from_bytes(unhexlify(line[SEQUENCE]), "little")
                    times.add(sequence)
                    publisher.publish(message(sequence))


def main() -> None:
    """Start the board, then echo until interrupted."""
    link, sensor_file, out = sys.argv[1:]
    sensor, times, end = load_sensor(sensor_file), TimeLog(), threading.Event()
    board, bus = started_bus(link, sensor)
    with ros([]) as stack:
        node = Node("echo", namespace="tactile")
        stack.callback(node.destroy_node)
        arguments = bus.fileno(), node, empty_message(sensor), times, end
        thread = threading.Thread(target=echo, args=arguments)
        thread.start()
        print("ready", flush=True)
        spin([node])
        end.set()
        thread.join()
    board.close()
    times.write(Path(out))


if __name__ == "__main__":
    main()
