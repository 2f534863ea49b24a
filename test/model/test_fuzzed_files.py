# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Files that nobody meant: each is read, or refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.calibration.calibration_file import load_calibration, save_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError, Section
from posfet_model.design.design_file import FOLDER as DESIGN_FOLDER
from posfet_model.design.design_file import load_design
from posfet_model.design.signal_file import read_signal
from posfet_model.plain_yaml import YamlError, parse
from posfet_model.ros.mount import parse_mount
from posfet_model.sensor.description import SENSOR_FOLDER, load_sensor
from posfet_model.spice.run_file import RunFileError, read_run
from support.fuzzing import COUNTS, TOKENS, assert_one_line, examples, mutated
from support.paths import DATA

SENSOR = load_sensor()


@pytest.mark.parametrize("count", COUNTS)
def test_any_text_is_yaml_or_refused(count: int) -> None:
    pieces = st.one_of(
        st.sampled_from([token.decode("utf-8", "surrogateescape") for token in TOKENS]), st.text(max_size=4)
    )

    @examples(3 * count)
    @given(st.lists(pieces, max_size=12).map("".join))
    def check(text: str) -> None:
        try:
            value = parse(text)
        except YamlError as error:
            assert_one_line(error)
            return
        try:
            Section("file", "", value).text("a")
        except ConfigError as error:
            assert_one_line(error)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_sensor_file_is_loaded_or_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "sensor.yaml"

    @examples(count)
    @given(mutated(*(shipped.read_bytes() for shipped in sorted(SENSOR_FOLDER.glob("*.yaml")))))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            assert load_sensor(path).layout.taxels > 0
        except ConfigError as error:
            assert_one_line(error, path)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_calibration_file_is_loaded_or_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "cal.yaml"
    save_calibration(path, SENSOR, Calibration.nominal(SENSOR))

    @examples(count)
    @given(mutated(path.read_bytes()))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            assert load_calibration(path, SENSOR).gain.shape == (SENSOR.layout.taxels,)
        except ConfigError as error:
            assert_one_line(error, path)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_follower_run_is_read_or_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "run.csv"
    head = b"".join((DATA / "spice" / "opamp_b_step.csv").read_bytes().splitlines(keepends=True)[:30])

    @examples(count)
    @given(mutated(head, b"time,v_in,v_out\n0,0,0\n1e-6,1,0.5\n2e-6,1,1\n"))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            assert len(read_run(path).time) >= 2
        except RunFileError as error:
            assert_one_line(error, path)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_design_file_is_loaded_or_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "design.yaml"

    @examples(count)
    @given(mutated(*(shipped.read_bytes() for shipped in sorted(DESIGN_FOLDER.glob("[ps]*.yaml")))))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            assert load_design(str(path)).design.shape == ()
        except ConfigError as error:
            assert_one_line(error, path)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_signal_is_read_or_refused(tmp_path: Path, count: int) -> None:
    path = tmp_path / "in.csv"

    @examples(count)
    @given(mutated(b"# a step\nt,vin\n0,0\n1e-6,0\n1e-6,1\n2e-6,1\n"))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            assert len(read_signal(path).time) >= 1
        except ConfigError as error:
            assert_one_line(error, path)

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_mount_is_read_or_refused(count: int) -> None:
    words = st.lists(st.one_of(st.floats().map(str), st.text(max_size=3)), max_size=8)

    @examples(count)
    @given(words.map(" ".join))
    def check(text: str) -> None:
        try:
            assert len(parse_mount(text).position) == 3
        except ConfigError as error:
            assert str(error).startswith("mount: must be six numbers")

    check()
