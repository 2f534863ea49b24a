# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The tables of the states of a connection: complete, and in agreement with each other."""

from __future__ import annotations

from posfet_driver.board.connection_state import HEALTH, NOT_RECEIVING, ConnectionState
from posfet_driver.board.faults import Health


def test_every_state_has_a_health() -> None:
    assert set(HEALTH) == set(ConnectionState)


def test_only_scans_and_a_stop_on_request_are_well() -> None:
    well = {state for state, health in HEALTH.items() if health is Health.OK}
    assert well == {ConnectionState.SCANS, ConnectionState.STOPPED}


def test_a_state_in_which_scans_may_come_is_no_error() -> None:
    receiving = set(ConnectionState) - NOT_RECEIVING
    assert receiving == {
        ConnectionState.IDENTITY,
        ConnectionState.RATE,
        ConnectionState.START,
        ConnectionState.SCANS,
    }
    assert {HEALTH[state] for state in receiving} == {Health.OK, Health.WARN}
