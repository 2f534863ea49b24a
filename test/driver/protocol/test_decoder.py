"""The decoder picks one board from the traffic of a bus; no frame can make it fail."""

from __future__ import annotations

import math
import random
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.protocol.decoder import Decoder, ScanReady, StatusReceived
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Page, Request, Status
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.emulation.firmware import BoardFirmware
from support.fake_board import FakeBoard, assert_marked, make_scan, with_fd

SENSOR = load_sensor()
BASE = SENSOR.can.base_id
PERIOD = round(1e9 / SENSOR.can.scan_rate)
WALL_OFFSET = 1_700_000_000_000_000_000
BOTH = pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
KINDS = st.sampled_from([CLASSIC, EXTENDED, REMOTE, ERROR, FD, FD | RATE_SWITCH, FD | EXTENDED])
NEAR_IDENTIFIERS = st.integers(BASE - 2, BASE + 14)
ANY_FRAME = st.tuples(
    st.one_of(NEAR_IDENTIFIERS, st.integers(0, 0x1FFF_FFFF)), KINDS, st.sampled_from([0, 1, 7, 8, 8, 12, 63, 64, 64])
).flatmap(lambda item: st.tuples(st.just(item[0]), st.just(item[1]), st.binary(min_size=item[2], max_size=item[2])))


def ask(decoder: Decoder, firmware: BoardFirmware, now: int) -> list[Frame]:
    """Return the response of a board to a request for the sequence of its next scan, which resolves an ambiguity."""
    if not decoder.resync_needed():
        return []
    decoder.note_start_sent(9, now)
    return firmware.receive((BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 9).pack()), now)


def receive(decoder: Decoder, frames: list[Frame], arrival: int, held_up: int = 0) -> list[Scan]:
    """Feed one batch that is read `held_up` [ns] late; return copies of the scans, compared with what was sent."""
    scans = []
    for decoded in decoder.decode(frames, arrival, WALL_OFFSET + held_up):
        if isinstance(decoded, ScanReady):
            assert_marked(decoder.scan)
            scans.append(make_scan(SENSOR, decoder.scan.sequence))
            scans[-1].stamp, scans[-1].status = decoder.scan.stamp, decoder.scan.status
    return scans


def started(fd: bool) -> tuple[BoardFirmware, Decoder]:
    """Return a running board and a decoder that knows the sequence of its next scan."""
    firmware = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), 0)
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.note_start_sent(1, 0)
    receive(decoder, firmware.receive((BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 1).pack()), 0), 0)
    decoder.resync(0, count_gap=False)
    return firmware, decoder


@given(frames=st.lists(ANY_FRAME, max_size=60), fd=st.booleans())
def test_arbitrary_frames_are_accepted_and_counted(frames: list[Frame], fd: bool) -> None:
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.resync(0, count_gap=False)
    scans = sum(isinstance(decoded, ScanReady) for decoded in decoder.decode(frames, 0, 0))
    assert decoder.scans == scans
    unrelated = [f for f in frames if not BASE <= f[0] < BASE + 13 and not f[1] & ERROR]
    assert decoder.traffic.unrelated >= len(unrelated)
    errors = ErrorCounts()
    errors.count(frames)
    assert errors.frames == sum(1 for f in frames if f[1] & ERROR)
    assert decoder.traffic.frames == len(frames)


@BOTH
def test_unrelated_traffic_has_no_effect(fd: bool) -> None:
    firmware, decoder = started(fd)
    noise = random.Random(1)
    scans = 0
    for index in range(200):
        frames = firmware.due(index * PERIOD)
        for _ in range(40):
            identifier = noise.choice([noise.randrange(0, BASE), noise.randrange(BASE + 13, 0x800)])
            frames.insert(noise.randrange(len(frames) + 1), (identifier, CLASSIC, noise.randbytes(8)))
        scans += len(receive(decoder, frames, index * PERIOD))
    assert scans == 200
    assert decoder.traffic.unrelated == 8000
    assert decoder.frames_lost == 0


@BOTH
def test_a_delay_between_two_clock_reads_does_not_shift_stamps(fd: bool) -> None:
    firmware, decoder = started(fd)
    scans = []
    for index in range(50):
        frames = firmware.due(index * PERIOD)
        scans += receive(decoder, frames, index * PERIOD, held_up=5_000_000 if index % 7 == 3 else 0)
    assert {later.stamp - scan.stamp for scan, later in pairwise(scans)} == {PERIOD}
    hour = 3_600_000_000_000
    for index in range(50, 53):  # the wall clock is set
        [scan] = receive(decoder, firmware.due(index * PERIOD), index * PERIOD, held_up=hour)
    assert scan.stamp - scans[-1].stamp == hour + 3 * PERIOD
    [scan] = receive(decoder, firmware.due(53 * PERIOD), 53 * PERIOD)
    assert scan.stamp - scans[-1].stamp == 4 * PERIOD


def mutate(noise: random.Random, frames: list[Frame]) -> list[Frame]:
    """Drop, truncate, duplicate, delay and relabel frames; the data of a block of unchanged length stay the same."""
    out: list[Frame] = []
    for identifier, kind, data in frames:
        fault = noise.random()
        if fault < 0.01:
            continue
        if fault < 0.02:
            out.append((identifier, kind, data[: noise.randrange(len(data))]))
        elif fault < 0.03:
            out += [(identifier, kind, data)] * 2
        elif fault < 0.04:
            out.append((identifier, kind ^ noise.choice([EXTENDED, REMOTE, ERROR]), data))
        elif fault < 0.05 and out:
            out.insert(-1, (identifier, kind, data))
        else:
            out.append((identifier, kind, data))
    return out


@BOTH
@pytest.mark.parametrize("seed", range(3))
def test_published_and_lost_scans_add_up_under_every_kind_of_fault(fd: bool, seed: int) -> None:
    """Single faults, bursts of any length, and a delayed host: every published scan was sent, others are counted."""
    noise = random.Random(seed)
    firmware, decoder = started(fd)
    sequences: list[int] = []
    now, waiting, count = 0, [], 4000
    while now < count * PERIOD:
        frames = firmware.due(now)
        event = noise.random()
        if event < 0.01:  # the cable is unplugged for a while, also in the middle of a scan
            for _ in range(noise.randrange(1, 50)):
                now += PERIOD
                frames += firmware.due(now)
            now += PERIOD
            rest = firmware.due(now)
            frames = frames[: noise.randrange(6)] + rest[len(rest) - noise.randrange(1, 6) :]
        elif event < 0.3:
            frames = mutate(noise, frames)
        waiting += frames
        if noise.random() < 0.95:  # else the host reads late
            sequences += [scan.sequence for scan in receive(decoder, waiting, now + 100_000)]
            waiting = ask(decoder, firmware, now + 100_000)
        now += PERIOD
    for _ in range(400):  # without faults again: complete scans and status frames settle the loss count
        sequences += [scan.sequence for scan in receive(decoder, waiting + firmware.due(now), now)]
        waiting = []
        now += PERIOD
    losses = decoder.statistics
    sent = now // PERIOD
    assert sequences == sorted(set(sequences))
    assert sequences[-1] == sent - 1
    assert len(sequences) > count / 2
    assert losses.incomplete_scans > 0 or fd  # a scan of one block cannot be incomplete
    assert losses.lost_scans > 0
    assert len(sequences) + losses.incomplete_scans + losses.lost_scans == sent


@BOTH
def test_garbage_uses_bounded_memory(fd: bool) -> None:
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.resync(0, count_gap=False)
    noise = random.Random(3)
    frames = [
        (BASE + noise.randrange(-2, 15), noise.choice([CLASSIC, FD, EXTENDED]), noise.randbytes(noise.choice([8, 64])))
        for _ in range(2000)
    ]

    def pour() -> None:
        for _ in range(5):
            for _ in decoder.decode(frames, 0, 0):
                pass

    pour()
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    pour()
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 4096


@BOTH
@pytest.mark.parametrize("pause", [5, 12, 16, 17, 40, 100])
@pytest.mark.parametrize("pieces", [1, 2, 5])
def test_a_delayed_sender_loses_no_scans(fd: bool, pause: int, pieces: int) -> None:
    """Delayed frames arrive at once, but are read in batches that end within scans; the sequence stays right."""
    firmware, decoder = started(fd)
    noise = random.Random(pause)
    sequences: list[int] = []
    now = 0
    for turn in range(1000):
        now += (pause if turn % 200 == 100 else 1) * PERIOD
        frames = firmware.due(now)
        cuts = (
            sorted(noise.randrange(1, 3 * len(frames) // pieces) for _ in range(pieces - 1))
            if turn % 200 == 100
            else []
        )
        for low, high in pairwise([0, *cuts, len(frames)]):
            now += 10_000
            sequences += [scan.sequence for scan in receive(decoder, frames[low:high], now)]
    assert sequences == list(range(len(sequences)))
    assert len(sequences) == now // PERIOD + 1 - (1 if firmware.due(now) else 0)
    assert decoder.frames_lost == 0


def test_status_frames_are_decoded(sensor: Sensor) -> None:
    decoder = Decoder(sensor)
    assert np.isnan(decoder.scan.temperatures).all()
    for page, value in ((Page.LAYOUT, 7), (Page.FIRMWARE, 0x0203)):
        status = Status((20.5, math.nan), 4.9, ScanStatus.SUPPLY_LOW, page, value)
        assert list(decoder.decode([(BASE + 2, CLASSIC, status.pack())], 0, 0)) == [StatusReceived(status)]
    np.testing.assert_array_equal(decoder.scan.temperatures, [20.5, math.nan])
    assert (decoder.layout_id, decoder.firmware) == (7, 0x0203)
    assert decoder.status.flags == ScanStatus.SUPPLY_LOW


def test_classic_scans_carry_the_flags_of_the_last_status() -> None:
    firmware, decoder = started(fd=False)
    status = Status((20.0, 20.0), 5.0, ScanStatus.ADC_FAULT, Page.LAYOUT, 1)
    list(decoder.decode([(BASE + 2, CLASSIC, status.pack())], 0, 0))
    frames = [frame for frame in firmware.due(0) if frame[0] != BASE + 2]
    (scan,) = receive(decoder, frames, 0)
    assert scan.status == ScanStatus.ADC_FAULT | ScanStatus.TIME_ESTIMATED


def test_stamps_of_fd_scans_are_acquisition_times() -> None:
    """Transit delays of up to 20 ms, a clock 40 ppm slow: the stamp error is below 0.1 ms."""
    firmware, decoder = started(fd=True)
    noise = random.Random(4)
    errors = []
    least = 150_000  # transit time without delay [ns]
    for index in range(5000):
        acquired = round(index * PERIOD * (1 + 40e-6))
        delay = least + round(noise.choice([0, 0, 0, 1e5, 1e6, 2e7]) * noise.random())
        for scan in receive(decoder, firmware.due(index * PERIOD), acquired + delay):
            errors.append(scan.stamp - WALL_OFFSET - acquired - least)
    assert len(errors) == 5000
    assert np.abs(errors[10:]).max() < 20_000


def test_sequence_and_stamps_restart_after_a_reset() -> None:
    firmware, decoder = started(fd=True)
    for index in range(100):
        receive(decoder, firmware.due(index * PERIOD), index * PERIOD)
    again = BoardFirmware(SENSOR, FakeBoard(SENSOR), 200 * PERIOD)
    again.receive((BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 2).pack()), 200 * PERIOD)
    decoder.resync(0, count_gap=True)
    (scan,) = receive(decoder, again.due(200 * PERIOD), 200 * PERIOD)
    assert scan.status & ScanStatus.BOARD_RESET
    assert scan.stamp == WALL_OFFSET + 200 * PERIOD
    assert decoder.scan.sequence == 0
    assert decoder.frames_lost == 0
