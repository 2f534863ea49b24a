# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The decoder picks one board from the traffic of a bus; no frame can make it fail."""

from __future__ import annotations

import math
import random
import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.protocol.decoded import IdentityReceived, ScanReady, StatusReceived
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    IDENTITY_OFFSET,
    RESPONSE_OFFSET,
    STATUS_OFFSET,
    Command,
    Identification,
    Identity,
    Request,
    Response,
    Result,
    Status,
)
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.emulation.firmware import BoardFirmware
from support.fake_board import FakeBoard, assert_marked, make_scan, with_fd
from support.long_cases import crossed, long_cases

SENSOR = load_sensor()
BASE = SENSOR.can.base_id
PERIOD = round(1e9 / SENSOR.can.scan_rate)
WALL_OFFSET = 1_700_000_000_000_000_000
FRAMES = {"fd": True, "classic": False}
BOTH = pytest.mark.parametrize("fd", FRAMES.values(), ids=FRAMES.keys())
KINDS = st.sampled_from([CLASSIC, EXTENDED, REMOTE, ERROR, FD, FD | RATE_SWITCH, FD | EXTENDED])
NEAR_IDENTIFIERS = st.integers(BASE - 2, BASE + 14)
ANY_FRAME = st.tuples(
    st.one_of(NEAR_IDENTIFIERS, st.integers(0, 0x1FFF_FFFF)), KINDS, st.sampled_from([0, 1, 7, 8, 8, 12, 63, 64, 64])
).flatmap(lambda item: st.tuples(st.just(item[0]), st.just(item[1]), st.binary(min_size=item[2], max_size=item[2])))


def receive(decoder: Decoder, frames: list[Frame], arrival: int, held_up: int = 0) -> list[Scan]:
    """Feed one batch that is read `held_up` [ns] late; return copies of the scans, compared with what was sent."""
    scans = []
    for decoded in decoder.decode(frames, arrival, WALL_OFFSET + held_up):
        if isinstance(decoded, ScanReady):
            assert_marked(decoder.scan)
            scans.append(make_scan(SENSOR, decoder.scan.sequence))
            scans[-1].stamp, scans[-1].status = decoder.scan.stamp, decoder.scan.status
    return scans


def started(fd: bool, transit: int = 0) -> tuple[BoardFirmware, Decoder]:
    """Return a board and a decoder that has received its first two scans, those before time 0."""
    firmware = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), -2 * PERIOD)
    decoder = Decoder(with_fd(SENSOR, fd))
    start = BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 1).pack()
    receive(decoder, firmware.receive(start, -2 * PERIOD), -2 * PERIOD)
    decoder.start()
    for now in (-2 * PERIOD, -PERIOD):
        receive(decoder, firmware.due(now), now + transit)
    return firmware, decoder


@given(frames=st.lists(ANY_FRAME, max_size=60), fd=st.booleans())
def test_arbitrary_frames_are_accepted_and_counted(frames: list[Frame], fd: bool) -> None:
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.start()
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


@pytest.mark.parametrize(
    ("fd", "spoilt"), [(True, "length"), (True, "checksum"), (False, "length")], ids=["fd", "fd checksum", "classic"]
)
def test_a_block_that_cannot_be_used_is_one_lost_frame(fd: bool, spoilt: str) -> None:
    firmware, decoder = started(fd)
    for index in range(40):
        frames = firmware.due(index * PERIOD)
        if index == 20:
            identifier, kind, data = frames[-1]
            frames[-1] = identifier, kind, data[:-1] + bytes([data[-1] ^ 1]) if spoilt == "checksum" else data[:-1]
        receive(decoder, frames, index * PERIOD)
    statistics = decoder.statistics
    assert (statistics.malformed + statistics.checksum, decoder.frames_lost) == (1, 1)


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


@pytest.mark.parametrize(("seed", "fd"), long_cases(crossed(range(3), FRAMES), ["0-classic", "1-fd"]))
def test_published_and_lost_scans_add_up_under_every_kind_of_fault(seed: int, fd: bool) -> None:
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
            waiting = []
        now += PERIOD
    for _ in range(400):  # without faults again: complete scans and status frames settle the loss count
        sequences += [scan.sequence for scan in receive(decoder, waiting + firmware.due(now), now)]
        waiting = []
        now += PERIOD
    losses = decoder.statistics
    sent = now // PERIOD
    assert sequences == sorted(set(sequences))
    assert sequences[-1] == sent + 1
    assert len(sequences) > count / 2
    assert losses.incomplete_scans > 0 or fd  # a scan of one block cannot be incomplete
    assert losses.lost_scans > 0
    assert len(sequences) + losses.incomplete_scans + losses.lost_scans == sent


@BOTH
def test_garbage_uses_bounded_memory(fd: bool) -> None:
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.start()
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


@pytest.mark.parametrize(
    ("pieces", "pause", "fd"),
    long_cases(
        crossed([1, 2, 5], [5, 12, 16, 17, 40, 100], FRAMES),
        [
            *(f"{pieces}-{pause}-classic" for pieces, pause in ((1, 5), (2, 16), (5, 17), (2, 100), (5, 100))),
            *(f"{pieces}-{pause}-fd" for pieces, pause in ((1, 100), (2, 5), (5, 40))),
        ],
    ),
)
def test_a_delayed_sender_loses_no_scans(pieces: int, pause: int, fd: bool) -> None:
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
    assert sequences == list(range(2, len(sequences) + 2))
    assert len(sequences) == now // PERIOD + 1 - (1 if firmware.due(now) else 0)
    assert decoder.frames_lost == 0


def status(**changes: object) -> Status:
    return replace(Status((20.0, 20.0), 5.0, 0, scanning=True, boot=0, heartbeat=0), **changes)


def test_status_and_identity_are_decoded(sensor: Sensor) -> None:
    decoder = Decoder(sensor)
    assert np.isnan(decoder.scan.temperatures).all()
    sent = status(temperatures=(20.5, math.nan), flags=int(ScanStatus.SUPPLY_LOW))
    assert list(decoder.decode([(BASE + STATUS_OFFSET, CLASSIC, sent.pack())], 0, 0)) == [StatusReceived(sent)]
    np.testing.assert_array_equal(decoder.scan.temperatures, [20.5, math.nan])
    identity = Identity(Identification(7, 2, True, 3), 4, 2000)
    assert list(decoder.decode([(BASE + IDENTITY_OFFSET, CLASSIC, identity.pack())], 0, 0)) == [
        IdentityReceived(identity)
    ]
    assert (decoder.identity, decoder.scan_period) == (identity, 2000)


def test_the_heartbeat_tells_repeated_and_lost_status_frames() -> None:
    decoder = Decoder(SENSOR)
    frames = [(BASE + STATUS_OFFSET, CLASSIC, status(heartbeat=beat).pack()) for beat in (14, 15, 15, 2, 3)]
    assert len(list(decoder.decode(frames, 0, 0))) == 4
    assert (decoder.traffic.status_repeated, decoder.traffic.status_lost) == (1, 2)


@pytest.mark.parametrize("period", [0, 10_000_001, 0xFF_FFFF])
def test_an_impossible_scan_period_is_not_believed(period: int) -> None:
    decoder = Decoder(SENSOR)
    response = Response(Command.SET_RATE, 1, Result.OK, period)
    identity = Identity(Identification(1, 2, True, 1), 0, period)
    frames = [(BASE + RESPONSE_OFFSET, CLASSIC, response.pack()), (BASE + IDENTITY_OFFSET, CLASSIC, identity.pack())]
    list(decoder.decode(frames, 0, 0))
    assert (decoder.scan_period, decoder.traffic.malformed) == (1000, 2)


@BOTH
def test_a_rate_that_another_host_sets_is_followed(fd: bool) -> None:
    firmware, decoder = started(fd)
    for index in range(100):
        receive(decoder, firmware.due(index * PERIOD), index * PERIOD)
    request = BASE + COMMAND_OFFSET, CLASSIC, Request(Command.SET_RATE, 77, 5000).pack()
    responses = firmware.receive(request, 99 * PERIOD)
    stamps = [scan.stamp for scan in receive(decoder, responses, 99 * PERIOD)]
    for now in range(100 * PERIOD, 400 * PERIOD, PERIOD):
        for decoded in decoder.decode(firmware.due(now), now, WALL_OFFSET):
            if isinstance(decoded, ScanReady):
                stamps.append(decoder.scan.stamp)
    assert decoder.scan_period == 5000
    assert set(np.diff(stamps)) == {5 * PERIOD}
    assert len(stamps) == 60
    assert decoder.frames_lost == 0


def test_classic_scans_carry_the_flags_of_the_last_status() -> None:
    firmware, decoder = started(fd=False)
    list(decoder.decode([(BASE + STATUS_OFFSET, CLASSIC, status(flags=int(ScanStatus.ADC_FAULT)).pack())], 0, 0))
    frames = [frame for frame in firmware.due(0) if frame[0] != BASE + STATUS_OFFSET]
    (scan,) = receive(decoder, frames, 0)
    assert scan.status == ScanStatus.ADC_FAULT


@BOTH
def test_stamps_are_acquisition_times(fd: bool) -> None:
    """Transit delays of up to 20 ms, a clock 40 ppm slow: the stamp error is below 0.1 ms."""
    least = 150_000  # transit time without delay [ns]
    firmware, decoder = started(fd, least)
    noise = random.Random(4)
    errors = []
    for index in range(5000):
        acquired = round(index * PERIOD * (1 + 40e-6))
        delay = least + round(noise.choice([0, 0, 0, 1e5, 1e6, 2e7]) * noise.random())
        for scan in receive(decoder, firmware.due(index * PERIOD), acquired + delay):
            truth = round((scan.sequence - 2) * PERIOD * (1 + 40e-6))
            errors.append(scan.stamp - WALL_OFFSET - truth - least)
    assert len(errors) > 4980  # of classic scans the newest may be held
    assert np.abs(errors[10:]).max() < 20_000


@BOTH
@pytest.mark.parametrize("seed", range(8))
def test_stamps_never_step_back_however_late_the_first_scans_are(fd: bool, seed: int) -> None:
    noise = random.Random(seed)
    firmware = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), 0)
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.start()
    receive(decoder, firmware.receive((BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 1).pack()), 0), 0)
    arrival, stamps = 0, []
    for sampled in range(0, 400 * PERIOD, PERIOD):
        late = noise.random() ** 4 * max(40 * PERIOD - sampled // 4, 0)
        arrival = max(arrival, sampled + round(late))
        for scan in receive(decoder, firmware.due(sampled), arrival):
            stamps.append(scan.stamp - WALL_OFFSET)
            assert stamps[-1] <= arrival
            error = stamps[-1] - scan.sequence * PERIOD
            assert error >= 0
            if sampled > 200 * PERIOD:  # an undelayed scan has arrived
                assert error <= decoder.clock_uncertainty * 1e9 + 1000
    assert len(stamps) > 300
    assert stamps == sorted(stamps)
    assert len(set(stamps[-150:])) == 150


@BOTH
@pytest.mark.parametrize("first", ["status", "scan"])
def test_sequence_and_stamps_restart_after_a_reset(fd: bool, first: str) -> None:
    """Whatever is heard first of the new boot, nothing of it is applied to the old numbering, and no counter falls."""
    firmware, decoder = started(fd)
    for index in range(100):
        receive(decoder, firmware.due(index * PERIOD), index * PERIOD)
    reset = 200 * PERIOD
    again = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), reset, boot=5)
    again.receive((BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 2).pack()), reset)
    scans = []
    for index in range(4):
        frames = again.due(reset + index * PERIOD)
        if first == "scan":
            frames = [frame for frame in frames if frame[0] - BASE not in {STATUS_OFFSET, IDENTITY_OFFSET}]
        scans += receive(decoder, frames, reset + index * PERIOD)
    assert [scan.sequence for scan in scans] == list(range(1 if fd else 0, 4))
    assert [bool(scan.status & ScanStatus.BOARD_RESET) for scan in scans] == [True] + [False] * (len(scans) - 1)
    assert scans[-1].stamp == WALL_OFFSET + reset + 3 * PERIOD
    assert (decoder.resets, decoder.frames_lost) == (1, 0)


@BOTH
@pytest.mark.parametrize(
    ("said", "expected"),
    [({}, 0), ({"charge_reset": True}, 1), ({"boot": 4}, 1)],
    ids=["charge continues", "charge reset", "not said"],
)
def test_a_reset_leaves_the_charge_known_only_where_the_board_says_so(
    fd: bool, said: dict[str, object], expected: int
) -> None:
    firmware, decoder = started(fd)
    for index in range(20):
        receive(decoder, firmware.due(index * PERIOD), index * PERIOD)
    reset = 200 * PERIOD
    again = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), reset, boot=5)
    again.receive((BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 2).pack()), reset)
    stated = status(**{"boot": 5, **said}).pack()
    list(decoder.decode([(BASE + STATUS_OFFSET, CLASSIC, stated)], reset, WALL_OFFSET))
    scans = []
    for index in range(4):
        frames = [frame for frame in again.due(reset + index * PERIOD) if frame[0] - BASE != STATUS_OFFSET]
        scans += receive(decoder, frames, reset + index * PERIOD)
    flags = [
        (bool(scan.status & ScanStatus.BOARD_RESET), bool(scan.status & ScanStatus.CHARGE_RESET)) for scan in scans
    ]
    assert flags == [(True, bool(expected))] + [(False, False)] * (len(scans) - 1)


@pytest.mark.parametrize("charge_reset", [True, False])
def test_a_new_driver_does_not_vouch_for_the_charge_that_an_earlier_one_has_seen(charge_reset: bool) -> None:
    firmware = BoardFirmware(SENSOR, FakeBoard(SENSOR), 0, boot=3, charge_reset=charge_reset)
    decoder = Decoder(SENSOR)
    decoder.start()
    firmware.receive((BASE + COMMAND_OFFSET, CLASSIC, Request(Command.START, 2).pack()), 0)
    scans = [scan for index in range(3) for scan in receive(decoder, firmware.due(index * PERIOD), index * PERIOD)]
    # In the first batch the scan precedes the status.
    assert [scan.status for scan in scans] == [0, int(ScanStatus.CHARGE_RESET) * charge_reset, 0]


@BOTH
@pytest.mark.parametrize("pause", [65.536, 65.536 * 3 + 31, 300.0, 4295.0, 10_000.0])
def test_a_host_that_was_stopped_numbers_and_stamps_right(fd: bool, pause: float) -> None:
    """What waited in the kernel is read at once, the newest frames are missing, then the scans of now arrive."""
    firmware, decoder = started(fd)
    for index in range(100):
        receive(decoder, firmware.due(index * PERIOD), index * PERIOD)
    waiting = [frame for index in range(100, 300) for frame in firmware.due(index * PERIOD)]
    later = 100 + round(pause * SENSOR.can.scan_rate)
    receive(decoder, waiting, later * PERIOD)
    firmware._position = firmware._sequence = later + 2
    firmware._status_sent = later // 100
    errors = []
    for now in range(later * PERIOD, (later + 200) * PERIOD, PERIOD):
        for scan in receive(decoder, firmware.due(now), now):
            errors.append(abs(scan.stamp - WALL_OFFSET - (scan.sequence - 2) * PERIOD) / 1e9)
    assert len(errors) >= 180
    assert errors[0] <= decoder.clock_uncertainty + 100e-6 * pause + 1e-9
    statistics = decoder.statistics
    assert decoder.scans + statistics.lost_scans + statistics.incomplete_scans == decoder.scan.sequence + 1


def test_a_damaged_block_is_counted_and_not_used() -> None:
    firmware, decoder = started(fd=True)
    noise = random.Random(2)
    for index in range(500):
        frames = firmware.due(index * PERIOD)
        if index % 5 == 3:
            identifier, kind, data = frames.pop(next(i for i, frame in enumerate(frames) if len(frame[2]) == 64))
            spoilt = bytearray(data)
            for _ in range(noise.randrange(1, 4)):
                spoilt[noise.randrange(64)] ^= 1 << noise.randrange(8)
            frames.append((identifier, kind, bytes(spoilt) if bytes(spoilt) != data else data[::-1]))
        receive(decoder, frames, index * PERIOD)
    assert (decoder.statistics.checksum, decoder.statistics.lost_scans) == (100, 100)


def test_commands_of_other_hosts_are_no_unrelated_traffic() -> None:
    decoder = Decoder(SENSOR)
    list(decoder.decode([(BASE, CLASSIC, Request(Command.START, 1).pack())], 0, 0))
    assert (decoder.traffic.commands, decoder.traffic.unrelated) == (1, 0)


def classic_scans(*sequences: int, number: int = 0, time: int = 0) -> list[Frame]:
    """Return the frames of classic scans by a board whose numbers and times [us] are shifted."""
    sensor, frames = with_fd(SENSOR, False), []
    for sequence in sequences:
        scan = make_scan(sensor, sequence)
        scan.sequence += number
        scan.device_time += time
        frames += make_codec(sensor).encode(scan, BASE, header=sequence % 16 == 0)
    return frames


def classic_decoder() -> Decoder:
    """Return a decoder that has received 32 scans, one each millisecond."""
    decoder = Decoder(with_fd(SENSOR, False))
    decoder.start()
    for sequence in range(32):
        list(decoder.decode(classic_scans(sequence), sequence * PERIOD, 0))
    return decoder


def test_classic_scans_are_not_counted_on_against_a_header_that_cannot_be() -> None:
    decoder, published = classic_decoder(), []
    for sequence in range(32, 200):
        for decoded in decoder.decode(classic_scans(sequence, number=160_000), sequence * PERIOD, 0):
            published.append(decoded)
    assert published == []
    assert decoder.statistics.implausible > 0


def test_a_classic_clock_that_jumps_does_not_measure_the_scan_period() -> None:
    decoder, errors = classic_decoder(), []
    for sequence in range(32, 200):
        for _ in decoder.decode(classic_scans(sequence, time=90_000_000), sequence * PERIOD, 0):
            errors.append(decoder.scan.stamp - decoder.scan.sequence * PERIOD)
    assert len(errors) > 160
    assert np.abs(errors).max() < 100_000


def scan_frames(
    fd: bool, sequence: int, time: int, number: int | None = None, header: bool | None = None
) -> list[Frame]:
    """Return the frames of a marked scan that states a device time [us], and perhaps another number."""
    sensor = with_fd(SENSOR, fd)
    scan = make_scan(sensor, sequence, time)
    scan.sequence = sequence if number is None else number
    return make_codec(sensor).encode(scan, BASE, header=scan.sequence % 16 == 0 if header is None else header)


def stamp_errors(decoder: Decoder, batches: list[tuple[int, list[Frame]]]) -> dict[int, int]:
    """Feed batches with their arrivals [ns]; return the error of the stamp [ns] by sequence: scans are 1 ms apart."""
    errors = {}
    for arrival, frames in batches:
        for scan in receive(decoder, frames, arrival):
            errors[scan.sequence] = scan.stamp - WALL_OFFSET - scan.sequence * PERIOD
    return errors


@pytest.mark.parametrize("jump", [1, 2, 5, 11])
def test_classic_counters_that_jump_spoil_no_stamps(jump: int) -> None:
    """A false number has a false time, which the next header corrects."""
    decoder = classic_decoder()
    lying = [(sequence, sequence + jump if 36 <= sequence < 40 else sequence) for sequence in range(32, 200)]
    batches = [
        (sequence * PERIOD, scan_frames(False, sequence, sequence * 1000, number, sequence % 16 == 0))
        for sequence, number in lying
    ]
    errors = []
    for arrival, frames in batches:
        for decoded in decoder.decode(frames, arrival, 0):
            if isinstance(decoded, ScanReady) and arrival >= 48 * PERIOD:
                errors.append(decoder.scan.stamp - decoder.scan.sequence * PERIOD)
    assert len(errors) >= 152
    assert np.abs(errors).max() < 20_000


def test_a_header_that_was_sampled_late_spoils_no_stamp_of_other_classic_scans() -> None:
    decoder = Decoder(with_fd(SENSOR, False))
    decoder.start()
    late = {48: 900_000, 96: 700_000}
    batches = [
        (
            sequence * PERIOD + late.get(sequence, 0),
            scan_frames(False, sequence, sequence * 1000 + late.get(sequence, 0) // 1000),
        )
        for sequence in range(200)
    ]
    errors = stamp_errors(decoder, batches)
    assert len(errors) == 200
    assert max(abs(error - late.get(sequence, 0)) for sequence, error in errors.items()) < 20_000


@BOTH
def test_stamps_during_a_frozen_clock_and_after_it_are_right(fd: bool) -> None:
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.start()
    batches = [
        (sequence * PERIOD, scan_frames(fd, sequence, 64_000 if 64 <= sequence < 300 else sequence * 1000))
        for sequence in range(400)
    ]
    errors = stamp_errors(decoder, batches)
    assert len(errors) >= 397  # of FD the first one is confirmed by the second
    assert max(map(abs, errors.values())) < 50_000
    assert decoder.frozen_clock > 10


@pytest.mark.parametrize(("repetitions", "frozen"), [(1, 0), (2, 0), (3, 1), (5, 3)])
def test_a_clock_counts_as_frozen_from_the_third_repetition_on(repetitions: int, frozen: int) -> None:
    """Before that, scans may have been sampled at the same time."""
    decoder = Decoder(with_fd(SENSOR, True))
    decoder.start()
    for sequence in range(60):
        time = 20_000 if 20 < sequence <= 20 + repetitions else sequence * 1000
        receive(decoder, scan_frames(True, sequence, time), sequence * PERIOD)
    assert decoder.frozen_clock == frozen


@BOTH
def test_a_clock_that_jumps_spoils_no_stamp(fd: bool) -> None:
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.start()
    batches = [
        (sequence * PERIOD, scan_frames(fd, sequence, sequence * 1000 + (123_456_789 if 100 <= sequence < 300 else 0)))
        for sequence in range(400)
    ]
    errors = stamp_errors(decoder, batches)
    assert len(errors) >= 396
    assert max(map(abs, errors.values())) < 50_000
    assert decoder.clock_uncertainty < 2e-3


def test_a_block_that_overtakes_its_header_confirms_no_number() -> None:
    """16 scans with their header are lost, and what follows is held with numbers that are 16 too low."""
    decoder = classic_decoder()
    batches = [(sequence * PERIOD, scan_frames(False, sequence, sequence * 1000)) for sequence in (32, 33)]
    batches += [(sequence * PERIOD, scan_frames(False, sequence, sequence * 1000)) for sequence in range(50, 64)]
    header, first, *rest = scan_frames(False, 64, 64_000)
    batches += [(64 * PERIOD, [first, header, *rest])]
    batches += [(sequence * PERIOD, scan_frames(False, sequence, sequence * 1000)) for sequence in range(65, 100)]
    assert sorted(stamp_errors(decoder, batches)) == [32, 33, *range(65, 100)]
    assert decoder.scans + decoder.statistics.lost_scans + decoder.statistics.incomplete_scans == 100


def test_a_classic_block_of_an_earlier_scan_is_late_however_late_it_is() -> None:
    """A counter of 4 bits could be that of a scan to come, which cannot have been sampled yet."""
    decoder = classic_decoder()
    batches = [(sequence * PERIOD, scan_frames(False, sequence, sequence * 1000)) for sequence in range(32, 60)]
    late = batches[8][1].pop()  # of scan 40
    batches[18][1].append(late)
    errors = stamp_errors(decoder, batches)
    assert sorted(errors) == [*range(32, 40), *range(41, 60)]
    assert (decoder.statistics.late, decoder.statistics.incomplete_scans, decoder.statistics.lost_scans) == (1, 1, 0)


def test_a_response_from_before_a_reset_sets_no_period() -> None:
    decoder = Decoder(with_fd(SENSOR, False))
    frames = [(BASE + STATUS_OFFSET, CLASSIC, status(boot=boot).pack()) for boot in (1, 2)]
    frames += [(BASE + RESPONSE_OFFSET, CLASSIC, Response(Command.SET_RATE, 1, Result.OK, 5000, boot=1).pack())]
    assert [type(decoded) for decoded in decoder.decode(frames, 0, 0)] == [StatusReceived, StatusReceived]
    assert (decoder.scan_period, decoder.resets) == (1000, 1)


@BOTH
@pytest.mark.parametrize("transit", [0, 15_000_000], ids=["undelayed", "delayed"])
@pytest.mark.parametrize("changed", [1, 8, 13, 15])
def test_a_period_that_another_host_sets_spoils_no_stamp(fd: bool, transit: int, changed: int) -> None:
    """The scans before the change had the earlier period, which a delay must not hide."""
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.start()
    first = 64 + changed  # scan at the new period
    times = {sequence: sequence * 1000 + max(sequence - first + 1, 0) * 1000 for sequence in range(120)}
    response = Response(Command.SET_RATE, 1, Result.OK, 2000, boot=0)
    errors = {}
    for sequence, time in times.items():
        frames = scan_frames(fd, sequence, time, header=sequence % 16 == 0 or sequence == first)
        if sequence == first:
            frames.insert(0, (BASE + RESPONSE_OFFSET, CLASSIC, response.pack()))
        delay = transit if sequence >= first - 5 else 0
        for scan in receive(decoder, frames, time * 1000 + delay):
            errors[scan.sequence] = scan.stamp - WALL_OFFSET - times[scan.sequence] * 1000
    assert len(errors) == 120
    assert max(map(abs, errors.values())) < 50_000


@BOTH
@pytest.mark.parametrize("late", [0.3, 0.6, 0.98])
def test_a_scan_that_a_busy_board_has_sampled_late_is_used_with_its_flag(fd: bool, late: float) -> None:
    """It missed three ticks, sampled the fourth late, and flags that."""
    codec, decoder = make_codec(with_fd(SENSOR, fd)), Decoder(with_fd(SENSOR, fd))
    decoder.start()
    published: list[tuple[int, int]] = []
    for sequence in [*range(48), *range(51, 67), *range(70, 100)]:
        scan = make_scan(SENSOR, sequence)
        sampled = sequence * PERIOD + round(late * PERIOD) * (sequence in (51, 70))
        scan.device_time, scan.status = sampled // 1000, ScanStatus.SCAN_OVERRUN * (sequence in (51, 70))
        frames = codec.encode(scan, BASE, 0, header=sequence % 16 == 0)
        for found in decoder.decode(frames, sampled, 0):
            if isinstance(found, ScanReady):
                published.append((found.scan.sequence, found.scan.status))
    assert [sequence for sequence, _ in published] == [*range(48), *range(51, 67), *range(70, 100)]
    assert decoder.statistics.lost_scans == 6
    if fd:  # classic scans have no flags of their own
        assert [sequence for sequence, status in published if status] == [51, 70]
