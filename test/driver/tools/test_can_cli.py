# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet can`, also as in own-board.md: every action over the emulated adapter and a virtual bus, and its errors."""

from __future__ import annotations

import subprocess
import sys
import uuid
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import can
import pytest

from posfet import can as posfet_can
from posfet_driver.bus import can_interface
from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.recording import messages, recording
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import STATUS_OFFSET, Identification, Identity, Status
from posfet_driver.protocol.scan_codec import make_codec
from posfet_driver.tools import list_boards, monitor, record_replay
from posfet_driver.tools.bus_options import bus_of
from posfet_driver.tools.can_cli import make_parser
from posfet_driver.tools.monitor import Monitor
from posfet_driver.tools.record_replay import decode
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import PacedClock, SteppedClock
from support.fake_board import FakeBoard, board_on_bus, make_scan, with_fd
from support.fake_socketcan import FakeSocketcan

SENSOR = load_sensor()
EMULATOR = ["-i", "emulator"]


@pytest.fixture(autouse=True)
def wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")


def main(arguments: list[str], clock: PacedClock | None = None) -> int:
    """Run the tool on a clock that waits for the tool and its board."""
    return posfet_can.main(arguments, clock or PacedClock())


@pytest.fixture
def clock() -> PacedClock:
    return PacedClock()


@pytest.fixture
def virtual(clock: PacedClock) -> Iterator[list[str]]:
    """A board on a virtual bus; returns the arguments that select it."""
    channel = uuid.uuid4().hex
    with (
        can.Bus(interface="virtual", channel=channel) as bus,
        board_on_bus(bus, BoardFirmware(SENSOR, FakeBoard(SENSOR), clock.monotonic()), clock),
    ):
        yield ["-i", "virtual", "-c", channel]


def test_bit_rates_of_the_options_are_those_of_the_sensor_as_well() -> None:
    """Bus load and bounds of stamps are computed with them."""
    rates = ["--bitrate", "250000", "--data-bitrate", "1000000"]
    options = make_parser().parse_args(["monitor", "-i", "virtual", "-c", "any", *rates])
    with bus_of(options) as (sensor, settings):
        for link in (sensor.can, settings):
            assert (link.bitrate, link.data_bitrate) == (250_000, 1_000_000)


def test_list_finds_the_board(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", *EMULATOR]) == 0
    cells = [cell.strip() for cell in capsys.readouterr().out.split("│")]
    assert "a simulated board" in cells
    assert cells[cells.index("0x100") : cells.index("0x100") + 4] == ["0x100", "1", "1.0", "5.00"]


def test_list_reports_why_an_adapter_is_unusable(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(list_boards, "SERIAL_PORTS", (str(tmp_path / "tty*"),))
    monkeypatch.setattr(can_interface, "NETWORK_DEVICES", tmp_path / "net")
    assert main(["list"]) == 0
    output = capsys.readouterr().out
    assert "no adapter found" in output
    assert "posfet can list -i emulator" in output
    (tmp_path / "ttyACM0").touch()
    (tmp_path / "net" / "can7").mkdir(parents=True)
    (tmp_path / "net" / "can7" / "type").write_text("280\n")
    (tmp_path / "net" / "eth0").mkdir()
    (tmp_path / "net" / "eth0" / "type").write_text("1\n")
    assert list_boards.adapters() == [("socketcan", "can7"), ("slcan", str(tmp_path / "ttyACM0"))]
    assert main(["list"]) == 0
    assert "not a serial port" in capsys.readouterr().out


def test_list_says_how_to_set_an_interface_up(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr(list_boards, "SERIAL_PORTS", ())
    kernel = FakeSocketcan(monkeypatch, tmp_path / "net")
    for name in ("can0", "can1"):
        kernel.add(name).switch(False)
    clock = SteppedClock()
    assert posfet_can.main(["list"], clock) == 0
    lines = capsys.readouterr().out.splitlines()
    settings = "up type can bitrate 1000000 dbitrate 5000000 fd on"
    assert lines[-2:] == [
        f"socketcan:{name}: the interface is down: sudo ip link set {name} {settings}" for name in ("can0", "can1")
    ]
    assert clock.now == 0
    kernel.close()


def test_only_a_sender_whose_heart_beats_is_listed_as_a_board() -> None:
    statuses = [Status((20.0, 20.0), 5.0, 0, True, 3, beat % 16).pack() for beat in range(13, 19)]
    identity = Identity(Identification(1, 2, True, 1), 4, 1000)
    frames = [(0x302, CLASSIC, data) for data in statuses] + [(0x305, CLASSIC, identity.pack())]
    other = [(0x402, CLASSIC, statuses[0])] * 6 + [(0x502, CLASSIC, bytes([0, 0, 0, 0, 0, 0xC0, 0, 0]))]
    search = list_boards.BoardSearch()
    for frame in frames + other:  # one at a time: a search keeps no frames
        search.process([frame])
    (board,) = search.found()
    assert board.row() == ["0x300", "1", "1.4", "5.00"]


@pytest.mark.parametrize("arguments", [["identify"], ["start"], ["stop"], ["self_test"], ["set_rate", "2000"]])
def test_each_command_is_acknowledged(
    virtual: list[str], clock: PacedClock, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["command", *arguments, *virtual], clock) == 0
    assert capsys.readouterr().out.startswith(f"{arguments[0]}: ok, ")


def test_a_rejected_command_shows_the_reason_of_the_board(
    virtual: list[str], clock: PacedClock, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["command", "set_rate", "3", *virtual], clock) == 1
    error = capsys.readouterr().err
    assert error == "posfet can command: SET_RATE: refused by the board: bad argument\n"


def test_monitor_shows_identifiers_rates_and_scans(
    virtual: list[str], clock: PacedClock, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["monitor", "--start", "--for", "0.5", *virtual], clock) == 0
    out = capsys.readouterr().out
    assert "scans/s" in out
    rows = [[cell.strip() for cell in line.split("│")[1:4]] for line in out.splitlines() if "│ 0x" in line]
    assert [row[:2] for row in rows if row[1] in {"Status", "ScanBlockFd"}] == [
        ["0x102", "Status"],
        ["0x103", "ScanBlockFd"],
    ]
    assert int(rows[-1][2]) > 100


def test_every_fault_of_the_frames_is_counted_in_the_monitor_and_in_the_summary_of_a_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also those that no scan block causes: a status that is cut short, a sequence that stands still."""
    file, scan, frames = tmp_path / "bus.log", make_scan(SENSOR, 0), []
    for sequence in range(6):
        scan.sequence, scan.device_time = min(sequence, 4), 1000 * sequence
        frames += make_codec(SENSOR).encode(scan, SENSOR.can.base_id)
    identifier, kind, data = frames[2]
    frames[2] = identifier, kind, data[:-1] + bytes([data[-1] ^ 1])
    frames.append((SENSOR.can.base_id + STATUS_OFFSET, CLASSIC, bytes(7)))
    watched = Monitor(SENSOR, SteppedClock())
    with recording(file) as log:
        for frame in frames:
            watched.process([frame])
            log(message_of(frame))
    assert main(["replay", str(file), "--decode"]) == 0
    rows = [[cell.strip() for cell in line.split("│")[1:3]] for line in capsys.readouterr().out.splitlines()]
    for label in ("checksum errors", "frozen sequence counter", "malformed frames", "lost scans"):
        assert [label, "1"] in rows
        assert f"{label} 1  " in watched.line()
    assert ["implausible sequence", "0"] in rows


def test_monitor_of_a_bus_without_traffic_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["monitor", "-i", "virtual", "-c", uuid.uuid4().hex, "--for", "0.05"]) == 1
    out = capsys.readouterr().out
    assert "no frame yet" in out
    assert "nan" not in out


def test_monitor_of_a_stopped_board_shows_no_scan(
    virtual: list[str], clock: PacedClock, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["monitor", "--for", "0.3", *virtual], clock) == 0
    out = capsys.readouterr().out
    assert "no complete scan yet" in out
    assert "newest scan" not in out


def test_the_monitor_makes_up_for_no_second_that_a_stop_has_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SteppedClock()

    class StoppedOnce:
        """A bus whose reader stands still for ten seconds after three."""

        def read_frames(self, timeout: float) -> list[Frame]:
            clock.sleep(timeout)
            clock.now += 10_000_000_000 if clock.now == 3_000_000_000 else 0
            return [(0x55, CLASSIC, b"")]

        def shutdown(self) -> None: ...

    ticks: list[int] = []
    monkeypatch.setattr(monitor, "open_bus", lambda _: StoppedOnce())
    monkeypatch.setattr(Monitor, "tick", lambda _: ticks.append(clock.now))
    posfet_can.main(["monitor", "-i", "virtual", "--for", "16"], clock)
    assert len(ticks) <= 7
    assert min(later - before for before, later in pairwise(ticks)) >= 100_000_000


def test_an_emulated_board_is_started(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["monitor", "--for", "0.3", *EMULATOR]) == 0
    assert "newest scan" in capsys.readouterr().out


@pytest.mark.parametrize("suffix", ["log", "asc", "blf"])
@pytest.mark.parametrize("fd", ["true", "false"])
def test_a_recording_can_be_decoded_and_replayed(
    tmp_path: Path, suffix: str, fd: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"bus.{suffix}"
    assert main(["record", str(file), "--start", "--for", "0.3", *EMULATOR, "--fd", fd]) == 0
    assert main(["replay", str(file), "--decode", "--fd", fd]) == 0
    assert "complete scans" in capsys.readouterr().out
    sent = [frame_of(message) for message in messages(file)]
    assert len(sent) > 100
    channel = uuid.uuid4().hex
    with can.Bus(interface="virtual", channel=channel) as bus:
        assert main(["replay", str(file), "--speed", "100", "-i", "virtual", "-c", channel, "--fd", fd]) == 0
        received = [frame_of(message) for message in iter(lambda: bus.recv(0), None)]
    assert f"{len(received)} frames sent" in capsys.readouterr().out
    # In order and unchanged; a machine that lets the replay stand still makes it skip scans.
    rest = iter(sent)
    assert len(received) > 0
    assert all(frame in rest for frame in received)


@pytest.mark.parametrize("fd", ["true", "false"])
def test_a_replay_that_stood_still_goes_on_in_time_with_whole_scans(
    tmp_path: Path, fd: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The process is stopped for 2 s within a scan of a board at 1 kHz."""
    clock, sensor = SteppedClock(), with_fd(SENSOR, fd == "true")
    decoder, sent = Decoder(sensor), []
    decoder.start()

    class Stopped:
        """A bus on which the frame after 0.7 s takes two seconds."""

        def send(self, message: can.Message, timeout: float | None = None) -> None:
            sent.append((clock.monotonic(), message))
            if message.arbitration_id == within and message.timestamp == 0.7:
                clock.sleep(2.0)
            for _ in decoder.decode([frame_of(message)], clock.monotonic(), 0):
                pass

        def shutdown(self) -> None: ...

    scan, file = make_scan(sensor, 0), tmp_path / "bus.log"
    within = sensor.can.base_id + (3 if sensor.can.fd else 10)
    with recording(file) as log:
        for scan.sequence in range(4000):
            scan.device_time = 1000 * scan.sequence
            for frame in make_codec(sensor).encode(scan, sensor.can.base_id):
                message = message_of(frame)
                message.timestamp = scan.sequence / 1000
                log(message)
    monkeypatch.setattr(record_replay, "open_can_bus", lambda _: Stopped())
    begin = clock.monotonic()
    assert posfet_can.main(["replay", str(file), "-i", "virtual", "--fd", fd], clock) == 0
    late = [(time - begin) / 1e9 - message.timestamp for time, message in sent]
    assert max(late) < 0.01
    total = len(list(messages(file)))
    printed = f"{len(sent)} frames sent, {total - len(sent)} skipped: the replay was more than 0.5 s late"
    assert capsys.readouterr().out.strip() == printed
    assert decoder.scans + decoder.statistics.lost_scans + decoder.statistics.incomplete_scans == 4000
    assert decoder.statistics.incomplete_scans == (0 if sensor.can.fd else 1)  # that in which it was stopped
    assert 1990 <= decoder.statistics.lost_scans <= 2016


def test_a_recording_decodes_to_complete_scans(tmp_path: Path) -> None:
    file = tmp_path / "bus.log"
    assert main(["record", str(file), "--start", "--for", "0.3", *EMULATOR]) == 0
    decoder = Decoder(SENSOR)
    decode(file, decoder, ErrorCounts())
    assert decoder.scans > 200
    assert decoder.frames_lost == 0


def test_a_recording_has_every_frame_that_arrives_with_a_response(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clock: PacedClock
) -> None:
    """Whatever shares a read with the response to START: the scans before it and after it."""

    class Adapter:
        """Answers each command in one batch, between the frames of other nodes."""

        def __init__(self) -> None:
            self.batch: list[can.Message] = []
            self.delivered: list[can.Message] = []
            self._firmware = BoardFirmware(SENSOR, FakeBoard(SENSOR), clock.monotonic())

        def send(self, message: can.Message, timeout: float | None = None) -> None:
            answers = [message_of(frame) for frame in self._firmware.receive(frame_of(message), clock.monotonic())]
            other = can.Message(arbitration_id=0x55, data=message.data, is_extended_id=False)
            self.batch += [other, *answers, other]

        def recv(self, timeout: float | None) -> can.Message | None:
            if not self.batch:
                clock.sleep(timeout or 0.0)
                return None
            self.delivered.append(self.batch.pop(0))
            return self.delivered[-1]

        def shutdown(self) -> None: ...

    adapter, file = Adapter(), tmp_path / "bus.log"
    monkeypatch.setattr(record_replay, "open_can_bus", lambda _: adapter)
    assert main(["record", str(file), "--start", "--for", "0.05", "-i", "virtual"], clock) == 0
    others = [message for message in adapter.delivered if message.arbitration_id == 0x55]
    assert len(others) == 6  # two with the response to each of SET_RATE, START and STOP
    assert [frame_of(message) for message in messages(file)] == [frame_of(message) for message in adapter.delivered]


def test_selftest_passes_on_the_emulated_board(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["selftest", *EMULATOR, "--for", "0.5"]) == 0, capsys.readouterr().out
    assert capsys.readouterr().out.count(" ok ") == 8


def test_selftest_reports_what_failed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["selftest", "-i", "slcan", "-c", str(tmp_path / "none")]) == 1
    out = capsys.readouterr().out
    assert "adapter opens" in out
    assert "No such file or directory" in out


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["command", "stop", "-i", "slcam"], "CAN interface must be one of"),
        (["command", "stop", "-i", "virtual", "-o", "nonsense=1"], "has no option 'nonsense', known are"),
        (["command", "stop", "-i", "virtual", "-s", "nosuch"], "nosuch: no such sensor"),
        (["command", "stop", "-i", "slcan", "-c", "/nowhere"], "slcan:/nowhere: No such file or directory"),
        (
            ["command", "stop", "-i", "virtual", "-c", "empty"],
            "STOP: no response within 0.5 s at base identifier 0x100",
        ),
        (["command", "stop", "-i", "virtual", "-o", "loud"], "CAN option must be 'key=value', got 'loud'"),
        (["list", "-i", "slcam"], "CAN interface must be one of"),
        (["list", "-i", "slcan"], "CAN interface 'slcan' needs a channel"),
        (["command", "set_rate", "-i", "virtual"], "set_rate: needs the scan period [us]"),
        (["command", "start", "5", "-i", "virtual"], "start: takes no argument"),
        (["record", "bus.txt", "-i", "virtual"], "bus.txt: must end with one of .log, .asc, .blf"),
        (["record", "no/a.log", "-i", "virtual"], "no/a.log: cannot be written: no is not a folder"),
        (["replay", "/nowhere.log"], "/nowhere.log: No such file or directory"),
    ],
)
def test_usage_mistakes_give_one_line_errors(
    arguments: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 1
    output = capsys.readouterr().err
    assert error in output
    assert output.startswith(f"posfet can {arguments[0]}: ")
    assert output.count("\n") == 1


@pytest.mark.parametrize("suffix", ["log", "asc", "blf"])
def test_a_malformed_recording_is_rejected_with_a_one_line_error(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"bus.{suffix}"
    file.write_bytes(b"(nonsense) \xff\x00 what\n" * 20)
    assert main(["replay", str(file)]) == 1
    assert capsys.readouterr().err.startswith(f"posfet can replay: {file}: no")


def test_a_truncated_recording_is_decoded_then_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, cut, none = (tmp_path / f"{name}.blf" for name in ("whole", "cut", "none"))
    assert main(["record", str(whole), "--for", "0.3", *EMULATOR]) == 0
    content = whole.read_bytes()
    cut.write_bytes(content[:-20])
    none.write_bytes(content[:3])
    capsys.readouterr()
    assert main(["replay", str(cut), "--decode"]) == 1
    output = capsys.readouterr()
    assert output.err == f"posfet can replay: {cut}: cut off after {len(content) - 20} of {len(content)} bytes\n"
    assert main(["replay", str(none), "--decode"]) == 1
    assert capsys.readouterr().err == f"posfet can replay: {none}: not a recording of its format\n"


@pytest.mark.parametrize("suffix", ["log", "asc"])
def test_an_empty_recording_is_rejected(tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / f"bus.{suffix}"
    file.touch()
    for arguments in ([], ["--decode"]):
        assert main(["replay", str(file), *arguments]) == 1
        assert capsys.readouterr().err == f"posfet can replay: {file}: contains no frame\n"


def test_invalid_frames_and_times_give_one_line_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bus.log"
    for line, error in (
        ("(nan) can0 123#11", f"{file}: times must be in [0, 1e+11] s, got nan"),
        ("(1e300) can0 123#11", f"{file}: times must be in [0, 1e+11] s, got 1e+300"),
        ("(2.0) can0 123##1" + "00" * 70, "frame at 2.000000 s cannot be sent: "),
    ):
        file.write_text(f"(1.0) can0 123#11\n{line}\n", encoding="ascii")
        assert main(["replay", str(file), "--speed", "100", *EMULATOR]) == 1
        output = capsys.readouterr().err
        assert output.startswith(f"posfet can replay: {error}")
        assert output.count("\n") == 1


def test_monitor_omits_a_table_that_does_not_fit(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["monitor", "--for", "0.5", "-s", "posfet_16x16", *EMULATOR]) == 0
    assert "the terminal needs 129 columns" in capsys.readouterr().out


def test_names_are_shown_without_markup(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["record", "[red]a.log", "--for", "0.3", *EMULATOR]) == 0
    assert capsys.readouterr().out.endswith(" frames in [red]a.log\n")
    assert main(["replay", "[red]a.log", "--decode"]) == 0
    assert "[red]a.log" in capsys.readouterr().out
    assert main(["selftest", "-i", "slcan", "-c", "[/red]"]) == 1
    assert "no port matches [/red]" in capsys.readouterr().out
    assert main(["list", "-i", "virtual", "-c", "[/red]", "--for", "0.1"]) == 0
    assert "[/red]" in capsys.readouterr().out


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs /dev/full")
@pytest.mark.parametrize("suffix", ["log", "asc", "blf"])
def test_a_full_disk_error_names_the_file(tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / f"bus.{suffix}"
    file.symlink_to("/dev/full")
    assert main(["record", str(file), "--for", "0.3", *EMULATOR]) == 1
    assert capsys.readouterr().err == f"posfet can record: {file}: cannot be written: No space left on device\n"


NO_ROOM = """
import resource, sys
from pathlib import Path
import can
from posfet_driver.bus.recording import recording
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
with recording(Path(sys.argv[1])) as log:
    log(can.Message(arbitration_id=1))
"""


@pytest.mark.parametrize("suffix", ["log", "asc", "blf"])
def test_no_empty_file_is_left_where_nothing_can_be_written(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"bus.{suffix}"
    run = subprocess.run([sys.executable, "-c", NO_ROOM, str(file)], capture_output=True, text=True, check=False)
    assert "cannot be written: File too large" in run.stderr
    assert not list(tmp_path.iterdir())


def test_no_file_is_left_of_a_board_that_cannot_be_started(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bus.log"
    assert main(["record", str(file), "--start", "-i", "virtual", "-c", uuid.uuid4().hex]) == 1
    assert "SET_RATE: no response within 0.5 s" in capsys.readouterr().err
    assert not file.exists()


@pytest.mark.parametrize("bus", [EMULATOR, ["-i", "nosuch"]], ids=["would be written", "would fail"])
def test_a_recording_is_never_overwritten(tmp_path: Path, bus: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "bus.log"
    file.write_text("of yesterday", encoding="ascii")
    assert main(["record", str(file), "--for", "0.1", *bus]) == 1
    error = f"posfet can record: {file}: cannot be written: File exists; choose another name, or remove it\n"
    assert capsys.readouterr().err == error
    assert file.read_text(encoding="ascii") == "of yesterday"


@pytest.mark.parametrize(
    "arguments", [["nothing"], ["command", "fly"], ["monitor", "--for", "-1"], ["replay", "x", "--speed", "nan"]]
)
def test_invalid_arguments_are_rejected(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
