"""docs/protocol.md agrees with the DBC, the code and the frame formats."""

from __future__ import annotations

import importlib.resources
import math

import cantools
import pytest

from posfet_driver.bus.frame import CLASSIC as CLASSIC_KIND
from posfet_driver.bus.frame import FD as FD_KIND
from posfet_driver.bus.frame_timing import BusTime, classic_time, fd_time
from posfet_driver.protocol import messages, scan_codec
from posfet_driver.protocol.decoder import Decoder, ResponseReceived, ScanReady, StatusReceived
from posfet_model.sensor.description import load_sensor
from support.paths import DOCS

TEXT = (DOCS / "protocol.md").read_text(encoding="utf-8")
DATABASE = cantools.database.load_string(
    (importlib.resources.files("posfet_driver") / "protocol" / "posfet.dbc").read_text(encoding="ascii"), "dbc"
)
BITRATE, DATA_BITRATE = 1e6, 5e6
CLASSIC = classic_time(8, BITRATE)
FD = fd_time(64, BITRATE, DATA_BITRATE)


def table(first: str) -> dict[str, list[str]]:
    """Return the rows of the table whose header begins with `first`, by their first cell."""
    lines = iter(TEXT.splitlines())
    for line in lines:
        if line.startswith(f"| {first} |"):
            next(lines)
            break
    rows = {}
    for line in lines:
        if not line.startswith("|"):
            break
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        rows[cells[0]] = cells[1:]
    return rows


def span(low: float, high: float) -> str:
    return f"{low:.1f}-{high:.1f}"


def test_every_signal_is_documented_with_its_bits() -> None:
    for message in DATABASE.messages:
        for signal in message.signals:
            if signal.name.startswith(("Count", "Code")) and signal.name != "CommandCode":
                continue
            name = signal.name if message.name[:-1] != "ScanBlock" else "ScanCounter k"
            last = signal.start + signal.length - 1
            bits = f"{signal.start}-{last}" if signal.length > 1 else f"{signal.start}"
            assert f"| {bits} | {name} |" in TEXT, signal.name


def test_taxel_positions_in_frames_follow_the_formulas() -> None:
    fd = DATABASE.get_message_by_name("ScanBlockFd")
    assert [s.start for s in fd.signals if s.name.startswith("Count")] == [
        64 + 16 * i for i in range(scan_codec.FD_TAXELS)
    ]
    for k in range(5):
        block = DATABASE.get_message_by_name(f"ScanBlock{k}")
        assert [(s.name, s.start) for s in block.signals[1:]] == [(f"Code{5 * k + i}", 4 + 12 * i) for i in range(5)]
        assert block.frame_id == 0x100 + messages.CLASSIC_BLOCK_OFFSET + k


@pytest.mark.parametrize(
    ("name", "offset"),
    [
        ("Command", messages.COMMAND_OFFSET),
        ("Response", messages.RESPONSE_OFFSET),
        ("Status", messages.STATUS_OFFSET),
        ("ScanBlockFd", messages.FD_BLOCK_OFFSET),
    ],
)
def test_identifiers_match_the_document(name: str, offset: int) -> None:
    message = DATABASE.get_message_by_name(name)
    row = table("offset")[str(offset)]
    assert message.frame_id == 0x100 + offset == int(row[0], 16)
    assert row[1:4] == [name, "FD, rate switch" if message.is_fd else "classic", str(message.length)]


def examples() -> dict[str, tuple[int, bytes, dict[str, float]]]:
    """Return identifier, data and signals of each example."""
    found = {}
    for name, (identifier, data, signals) in table("example").items():
        pairs = [pair.split() for pair in signals.split(", ")]
        found[name] = int(identifier, 16), bytes.fromhex(data), {key: float(value) for key, value in pairs}
    return found


@pytest.mark.parametrize("name", examples())
def test_examples_agree_with_cantools_in_both_directions(name: str) -> None:
    identifier, data, signals = examples()[name]
    message = DATABASE.get_message_by_frame_id(identifier)
    data = data.ljust(message.length, b"\0")
    decoded = message.decode(data, decode_choices=False)
    assert {key: decoded[key] for key in signals} == signals
    assert all(value == 0 for key, value in decoded.items() if key not in signals)
    assert message.encode({**decoded, **signals}, strict=False) == data  # -128 degC: unknown


def test_examples_agree_with_the_driver() -> None:
    decoder = Decoder(load_sensor())
    decoder.resync(1234, count_gap=False)
    answers, temperatures = [], []
    for identifier, data, signals in examples().values():
        scan = "Count0" in signals
        frame = (identifier, FD_KIND, data.ljust(64, b"\0")) if scan else (identifier, CLASSIC_KIND, data)
        for decoded in decoder.decode([frame], 0, 0):
            if isinstance(decoded, ScanReady):
                assert decoded.scan.device_time == 1234567
                assert decoded.scan.counts[:4].tolist() == [32768, 65535, 4660, 0]
            elif isinstance(decoded, ResponseReceived):
                answers.append((decoded.response.result, decoded.response.value, decoded.response.reset))
            elif isinstance(decoded, StatusReceived):
                status = decoded.status
                temperatures.append((*status.temperatures, status.supply, status.flags))
    assert decoder.scans == 1
    assert answers == [(0, 2000, False), (0, 0, True), (4, 2, False)]
    assert temperatures[0] == pytest.approx((25.5, math.nan, 5.0, 1), nan_ok=True)
    assert temperatures[1] == (-1.5, -1.5, 5.0, 0)


def test_status_period_matches_the_document() -> None:
    assert DATABASE.get_message_by_name("Status").cycle_time == messages.STATUS_PERIOD * 1000 == 100


def test_frame_times_match_the_document() -> None:
    rows = table("frame")
    assert rows["classic, 8 bytes"] == [f"{CLASSIC.least * 1e6:.1f}", f"{CLASSIC.most * 1e6:.1f}"]
    assert rows["FD, 64 bytes"] == [f"{FD.least * 1e6:.1f}", f"{FD.most * 1e6:.1f}"]


@pytest.mark.parametrize(
    ("layout", "taxels", "fd"),
    [("5 x 5, FD", 25, True), ("5 x 5, classic", 25, False), ("16 x 16, FD", 256, True), ("32 x 32, FD", 1024, True)],
)
def test_bus_load_matches_the_document(layout: str, taxels: int, fd: bool) -> None:
    blocks = (scan_codec.FdCodec if fd else scan_codec.ClassicCodec)(taxels).blocks
    frame: BusTime = FD if fd else CLASSIC
    statuses = 1 / messages.STATUS_PERIOD
    least, most = blocks * frame.least, blocks * frame.most
    load = [100 * (1000 * scan + statuses * status) for scan, status in ((least, CLASSIC.least), (most, CLASSIC.most))]
    highest = (1 - statuses * CLASSIC.most) / most
    assert table("layout, format")[layout] == [
        str(blocks),
        span(least * 1e6, most * 1e6),
        f"{span(*load)} %" if load[1] <= 100 else "-",
        f"{int(highest)}",
    ]


def test_frame_times_agree_with_the_published_formula() -> None:
    """Davis et al., Real-Time Systems 35 (2007): at most 55 + 10 s bits for s bytes, including intermission."""
    for length in range(9):
        assert classic_time(length, 1.0).most == 55 + 10 * length


@pytest.mark.parametrize("arguments", [(9, 1e6), (-1, 1e6), (8, 0.0), (8, float("nan"))])
def test_frame_times_of_invalid_frames_are_rejected(arguments: tuple[int, float]) -> None:
    with pytest.raises(ValueError, match=r"must be in|must be a whole"):
        classic_time(*arguments)
