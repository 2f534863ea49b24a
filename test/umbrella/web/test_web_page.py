# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The page in headless Chromium: what it shows equals what the server sends."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from posfet.diagnosis import Diagnosis
from posfet.web.server import WebServer
from support.browser import CHROMIUM, Page, browser
from support.web_sensors import ARRAY, SNAPSHOT, TOKEN, FakeRecordings, FakeSensor

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is missing: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Page]:
    with browser() as page:
        yield page


@pytest.fixture
def page(chromium: Page) -> Iterator[Page]:
    chromium.errors.clear()
    yield chromium
    chromium.open("about:blank")


def field(name: str, card: int = 0) -> str:
    """Return an expression for the text of a field of a sensor."""
    return f"document.querySelectorAll('.sensor')[{card}].querySelector('[data-field={name}]').textContent"


def wait_text(page: Page, name: str, text: str, card: int = 0) -> None:
    page.wait(f"{field(name, card)}.includes({text!r})")


def test_the_values_are_those_of_the_messages(page: Page) -> None:
    sensor = FakeSensor()
    values = {"fault: no traffic": "there is no signal on the bus; check cable"}
    sensor.diagnoses = {"driver_node: board": Diagnosis("driver_node: board", 2, "no traffic", values)}
    with WebServer([sensor.viewed], TOKEN, scenes=["press", "hold"]) as server:
        page.open(server.link)
        wait_text(page, "total", "1.250 N")
        wait_text(page, "total-deviation", "± 0.016 N")
        wait_text(page, "contacts", "#7moving1.250 ± 0.004+1.00, −0.509.02.5")
        wait_text(page, "truth", "1.25 N")
        wait_text(page, "losses", "3 frames lost, 2 scans missing")
        wait_text(page, "kind", "small S-1, 3 × 2, flat, simulated")
        wait_text(page, "notice", "uncalibrated: forces may be off by 10%")
        wait_text(page, "validity", "no new scans for")  # the stamp is years old
        wait_text(page, "diagnoses", "no traffic: there is no signal on the bus; check cable")
        page.evaluate("document.querySelector('details').open = true")
        # Last row first, since y points up: saturated taxel 2 is in the first row; unknown is "?", -0 is 0.
        page.wait(
            "[...document.querySelectorAll('details td')].map((cell) => cell.textContent).join(' ')"
            " === '0.0000 ? 0.0313 0.0000 0.1250 1.1500'"
        )
        page.evaluate("document.querySelector('.map').focus()")
        wait_text(page, "taxel", "row 1, column 1: unknown N")
        page.press("ArrowRight")
        wait_text(page, "taxel", "row 1, column 2: 0.031 ± ? N")
        assert page.errors == []


def test_a_small_deviation_has_digits_and_one_is_singular(page: Page) -> None:
    changed = replace(SNAPSHOT, standard_deviation=np.full(6, 0.0002, np.float32), frames_lost=1, scans_lost=1)
    sensor = FakeSensor(shown=replace(changed, force=np.full(6, -0.002, np.float32)))
    with WebServer([sensor.viewed], TOKEN) as server:
        page.open(server.link)
        wait_text(page, "taxel", "row 1, column 1: −0.0020 ± 0.0002 N")
        wait_text(page, "losses", "1 frame lost, 1 scan missing")
        assert page.errors == []


def test_unknown_is_a_word(page: Page) -> None:
    force = np.full(6, math.nan, np.float32)
    sensor = FakeSensor(shown=replace(SNAPSHOT, force=force, total_force=math.nan, data_valid=False, contacts=()))
    with WebServer([sensor.viewed], TOKEN) as server:
        page.open(server.link)
        wait_text(page, "total", "unknown")
        wait_text(page, "contacts", "unknown until forces are valid")
        assert page.errors == []


def test_a_page_finds_the_stack_again_after_a_restart(page: Page) -> None:
    with WebServer([FakeSensor().viewed], TOKEN) as server:
        port = server.guard.port
        page.open(server.link)
        wait_text(page, "total", "1.250 N")
    page.wait("document.getElementById('connection').textContent === 'reconnecting'")
    sensor = FakeSensor(shown=replace(SNAPSHOT, total_force=0.5, scans=1))
    with WebServer([sensor.viewed], TOKEN, port):
        wait_text(page, "total", "0.500 N")
        page.wait("document.getElementById('connection').textContent === 'live'")


def test_keys_tare_and_pause_the_chosen_sensor(page: Page) -> None:
    bent = replace(ARRAY, bend_radius=5e-3)
    thumb, palm = FakeSensor("hand/thumb"), FakeSensor("hand/palm", array=bent, recordings=FakeRecordings())
    with WebServer([thumb.viewed, palm.viewed], TOKEN) as server:
        page.open(server.link, width=400)
        wait_text(page, "total", "1.250 N")
        wait_text(page, "kind", "bent to 5.0 mm", card=1)
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        page.wait("!document.querySelectorAll('[data-action=tare]')[1].disabled")
        page.press("2")
        page.press("t")
        wait_text(page, "answer", "tare done", card=1)
        assert (thumb.requests, palm.requests) == ([], [("tare", False)])
        record = "document.querySelectorAll('[data-action=record]')[1].getAttribute('aria-pressed')"
        page.press("r")
        page.wait(f"{record} === 'true'")
        page.press("r")
        wait_text(page, "answer", "thumb.mcap: 2.0 s, 40 messages", card=1)
        page.wait(f"{record} === 'false'")
        page.press(" ")
        page.wait("document.getElementById('connection').textContent === 'paused'")
        thumb.shown = replace(SNAPSHOT, total_force=0.5)
        page.wait("document.getElementById('pause').getAttribute('aria-pressed') === 'true'")
        assert "1.250 N" in page.evaluate(field("total"))
        page.press(" ")
        wait_text(page, "total", "0.500 N")
        page.press("d")
        page.wait("document.documentElement.dataset.theme === 'light'")
        assert page.errors == []


def test_a_link_without_its_token_is_refused_with_a_word(page: Page) -> None:
    with WebServer([FakeSensor().viewed], TOKEN) as server:
        page.open(server.link.split("?")[0])
        page.wait("document.getElementById('connection').textContent.includes('open the link that posfet printed')")
