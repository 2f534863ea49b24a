# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet can conform`: table, JSON, exit codes, errors; in virtual time, but for one run with the emulated board."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from posfet import can as posfet_can
from posfet_driver.bus.frame import Frame
from posfet_driver.conformance.description import load_description
from posfet_driver.conformance.records import JITTER
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation import bus_peer
from posfet_sim.emulation.backlog import LONGEST_BACKLOG
from support.clocks import SteppedClock
from support.lateness import Lateness
from support.protocol_board import ProtocolBoard
from support.stepped import SteppedBus
from support.wrong_boards import HasNoHeartbeat, HasOneBootForEver

RULES = [*load_description().rules, "offsets", "checksum", "identity", "states", "commands"]
TIMED = {rule for rule in RULES if rule[0] == "T"} | {"S1", "I1", "I2", "C2"}
"""Rules that state a time."""
ARGUMENTS = ["conform", "-i", "virtual", "-c", "bench"]


@pytest.fixture
def conform(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, SteppedBus]]:
    """Run the command on a board in virtual time; what asks for a power cycle does it."""
    monkeypatch.setenv("COLUMNS", "200")
    link = load_sensor().can

    def run(kind: type[ProtocolBoard], *arguments: str) -> tuple[int, SteppedBus]:
        clock = SteppedClock(1_000_000_000)
        board = kind(link.base_id, 25, 1, link.fd, round(1e6 / link.scan_rate), clock.now)
        bus = SteppedBus(clock, board)
        monkeypatch.setattr("posfet_driver.tools.conform.open_bus", lambda settings: bus)
        prompt = "posfet_driver.tools.conform._ask_for_power_cycle"
        monkeypatch.setattr(prompt, lambda: board.switch_on(clock.now + 1_000_000_000))
        return posfet_can.main([*ARGUMENTS, *arguments], clock), bus

    return run


def test_a_right_board_passes(
    conform: Callable[..., tuple[int, SteppedBus]], capsys: pytest.CaptureFixture[str]
) -> None:
    code, bus = conform(ProtocolBoard)
    assert (code, bus.closed) == (0, True)
    out = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in out.splitlines() if line.startswith("│")]
    assert [row[0] for row in rows if row[0]] == RULES
    assert ["S1", "pass"] in [row[:2] for row in rows]
    assert all(row[3].startswith("#") for row in rows if row[0])
    assert out.endswith("28 passed, 0 failed, 4 not checked\n")


def test_a_wrong_board_fails(
    conform: Callable[..., tuple[int, SteppedBus]], capsys: pytest.CaptureFixture[str]
) -> None:
    code, bus = conform(HasNoHeartbeat, "--json", "--seed", "5")
    assert (code, bus.closed) == (1, True)
    findings = json.loads(capsys.readouterr().out)["findings"]
    assert [finding["rule"] for finding in findings] == RULES
    assert [finding for finding in findings if finding["result"] == "fail"] == [
        {
            "rule": "I3",
            "text": "Heartbeat counts the status frames, modulo 16.",
            "result": "fail",
            "seen": "3 follows 3",
            "place": "docs/protocol.md#i3",
        }
    ]


def test_what_follows_power_on_is_checked_on_request(
    conform: Callable[..., tuple[int, SteppedBus]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert conform(HasOneBootForEver)[0] == 0
    assert "with --power-cycle" in capsys.readouterr().out
    assert conform(HasOneBootForEver, "--power-cycle")[0] == 1
    assert "6 before and after power-on" in capsys.readouterr().out


def test_a_missing_board_gives_a_one_line_error(
    conform: Callable[..., tuple[int, SteppedBus]], capsys: pytest.CaptureFixture[str]
) -> None:
    class Silent(ProtocolBoard):
        def send(self, frame: Frame) -> list[Frame]:
            return []

    code, bus = conform(Silent)
    assert (code, bus.closed) == (1, True)
    error = "posfet can conform: no Status frame within 1 s at base identifier 0x100\n"
    assert capsys.readouterr().err == error


@pytest.mark.slow
def test_the_emulated_board_conforms_in_real_time(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rules about time cannot be judged while this process is not run for longer than the checks allow.

    Nor can the others if that is so long that the emulated adapter loses frames.
    """
    peers: list[bus_peer.SimulatedBusPeer] = []

    class Peer(bus_peer.SimulatedBusPeer):
        def open(self) -> None:
            peers.append(self)
            super().open()

    monkeypatch.setattr(bus_peer, "SimulatedBusPeer", Peer)
    with Lateness() as lateness:
        posfet_can.main(["conform", "-i", "emulator", "--json"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    failed = {finding["rule"]: finding["seen"] for finding in findings if finding["result"] == "fail"}
    assert not failed or lateness.longest > JITTER, failed
    (peer,) = peers
    if lateness.longest <= LONGEST_BACKLOG and not peer.report().frames_lost:
        assert TIMED.issuperset(failed), failed
        passed = sum(finding["result"] == "pass" for finding in findings)
        assert passed >= 27 - len(failed)  # T5, too, where the machine made the board miss scans
