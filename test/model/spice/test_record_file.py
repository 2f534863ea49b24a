# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Files of recorded runs."""

from pathlib import Path

import numpy as np
import pytest

from posfet_model.spice.record_file import load, save
from support.spice_data import FOLDER, recorded


def test_files_are_compact() -> None:
    assert sum(file.stat().st_size for file in (FOLDER / "circuits").iterdir()) < 500_000


def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    before = recorded("one_stage")
    save(tmp_path / "again.npz", before)
    after = load(tmp_path / "again.npz")
    for name in ("loop", "bias_point", "deck_hash", "slew_rates", "follower_gain", "unstable"):
        assert getattr(after, name) == getattr(before, name)
    for name, run in before.runs.items():
        np.testing.assert_array_equal(after.runs[name].time, run.time)
        np.testing.assert_allclose(after.runs[name].v_out, run.v_out, atol=np.ptp(run.v_out) / 60000)


def test_what_is_no_record_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", time=np.zeros(3))
    with pytest.raises(ValueError, match="is no record"):
        load(tmp_path / "other.npz")
