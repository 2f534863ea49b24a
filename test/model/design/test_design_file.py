# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Design files: units, unknown keys, wrong values, sweeps and tolerances; the shipped ones; the documented keys."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import pytest

from posfet_model.config import ConfigError
from posfet_model.design import report
from posfet_model.design.design_file import FOLDER, DesignFile, load_design, shipped
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.design.sweep import run_sweep
from posfet_model.design.tolerance import Tolerance, run_tolerance
from posfet_model.device.taxel_fields import FilmGeometry, plausible_fields
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.netlist import subcircuit
from support.each_row import each_row
from support.paths import DOCS


def load(folder: Path, text: str) -> DesignFile:
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_design(str(path))


def refused(folder: Path, text: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load(folder, text)
    message = str(caught.value)
    assert "\n" not in message
    prefix = f"{folder / 'mine.yaml'}: "
    assert message.startswith(prefix)
    return message.removeprefix(prefix)


def test_numbers_are_in_si_or_have_a_unit(tmp_path: Path) -> None:
    loaded = load(
        tmp_path,
        "film_thickness: 3 um\nfilm_area: 2.0e-6\ncoercive_field: 1.6e7\ncompensation: 30e-12\n"
        "poling_voltages: [80 V, -20, 0]\nstages: 1\nfilm_geometry: as in paper\nadc_bits: 12\n",
    )
    design = loaded.design
    assert loaded.name == "mine"
    assert (design.film_thickness, design.film_area, design.coercive_field) == (3e-6, 2e-6, 1.6e7)
    assert design.compensation == pytest.approx(30e-12, rel=1e-15)
    assert design.poling_voltages == (80.0, -20.0, 0.0)
    assert (design.stages, design.film_geometry, design.adc_bits) == (1, FilmGeometry.AS_IN_PAPER, 12)
    assert loaded.sweep is loaded.tolerance is None
    assert design.bias_resistance == PosfetDesign().bias_resistance


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "film_thickness: 2.5",
            "film_thickness: must be in [1e-08, 0.001] m, got 2.5; meant in um? 2.5 um is 2.5e-06 m",
        ),
        ("coercive_field: 160", "coercive_field: must be in [100000, 1e+10] V/m, got 160; meant in kV/cm? "),
        ("film_thickness: 2.5 pF", "film_thickness: must be a number, alone or with a unit of m, um, nm, mm, cm, got"),
        ("film_thickness: thin", "film_thickness: must be a number, alone or with a unit of m, um,"),
        ("film_thickness: [1, 2]", "film_thickness: must be a number in m, or with a unit such as 2.5 um, got [1, 2]"),
        ("film_thickness: true", "film_thickness: must be a number in m, or with a unit such as 2.5 um, got True"),
        ("film_thickness: .nan", "film_thickness: must be in [1e-08, 0.001] m, got nan"),
        ("supply: .inf", "supply: must be in [0.5, 100] V, got inf"),
        ("film_thickness:", "film_thickness: must be a number in m, or with a unit such as 2.5 um, got nothing"),
        ("poling_voltages:", "poling_voltages: must be a list of at most 1000 voltages, got nothing"),
        ("poling_voltages: [80, .inf]", "poling_voltages: must be of a magnitude in [0, 100000] V, got inf"),
        (
            "film_thicknes: 2.5 um",
            "film_thicknes: unknown key, did you mean film_thickness? known here are film_area, ",
        ),
        ("colour: red", "colour: unknown key, known here are film_area, "),
        ("stages: 3", "stages: must be a whole number in [1, 2], got 3"),
        ("film_geometry: round", "film_geometry: must be one of extended, as in paper, got 'round'"),
        ("poling_voltages: 80", "poling_voltages: must be a list of at most 1000 voltages, got 80"),
        ("poling_voltages: [80 um]", "poling_voltages: must be a number, alone or with a unit of V,"),
        ("remnant_polarisation: 0.06", "remnant_polarisation must be below saturation_polarisation"),
        ("sweep: 3", "sweep[0]: must be a mapping of keys to values, got 3"),
        ("sweep: []", "sweep: must be ranges of different fields, got none"),
        (
            "sweep: {field: film_are, from: 1, to: 2, points: 3}",
            "sweep[0].field: no such name 'film_are', did you mean film_area? ",
        ),
        (
            "sweep: {field: supply, from: 4, to: 5, points: 1}",
            "sweep[0].points: must be a whole number in [2, 10000], got 1",
        ),
        ("sweep: {field: supply, from: 4, to: 4, points: 2}", "sweep[0].to: must differ from 'from', got 4 for both"),
        (
            "sweep: {field: supply, from: 4, to: 4000, points: 2}",
            "sweep[0].to: must be in [0.5, 100] V, got 4000; meant in mV? ",
        ),
        ("sweep: {field: adc_low, from: -4, to: 4, points: 3, log: true}", "sweep[0].log: must be false for a range"),
        ("sweep: {field: supply, from: 4, to: 5, points: 3, step: 1}", "sweep[0].step: unknown key"),
        (
            "sweep: [{field: supply, from: 4, to: 5, points: 3}, {field: supply, from: 4, to: 5, points: 3}]",
            "sweep: must be ranges of different fields, got supply, supply",
        ),
        (
            "sweep: [{field: supply, from: 4, to: 5, points: 9999}, {field: adc_bits, from: 2, to: 9, points: 200}]",
            "sweep: must be at most 1000000 designs together, got 1999800",
        ),
        ("tolerance: {samples: 0}", "tolerance.samples: must be a whole number in [1, 1000000], got 0"),
        (
            "tolerance: {spread: {film_area: 5}}",
            "tolerance.spread.film_area: must be in [0, 1], got 5; meant in %? 5 % is 0.05",
        ),
        (
            "tolerance: {spread: {film_are: 0.1}}",
            "tolerance.spread.film_are: no such name 'film_are', did you mean film_area?",
        ),
        ("tolerance: {limits: {gain: {min: 1}}}", "tolerance.limits.gain: no such name 'gain', did you mean gain_db?"),
        ("tolerance: {limits: {gain_db: {least: 1}}}", "tolerance.limits.gain_db.least: unknown key"),
        ("tolerance: {limits: {gain_db: 60}}", "tolerance.limits.gain_db: must be {min: ..., max: ...} or one of them"),
        ("tolerance: {limits: {gain_db: {}}}", "tolerance.limits.gain_db: must be {min: ..., max: ...} or one of them"),
        (
            "tolerance: {limits: {gain_db: {min: 60, max: 50}}}",
            "tolerance.limits.gain_db: must have a max above its min, got 50 and 60",
        ),
        ("measured: 3", "measured: must be a mapping of keys to values, got 3"),
        (
            "measured: {gain_db: 42, gbw_hz: 1 MHz}",
            "measured.phase_margin_deg: missing, must be a number in [-85, 179]",
        ),
        ("measured: {gbw_hz: 1.0e6, phase_margin_deg: 60}", "measured.gain_db: missing, must be a number in dB"),
        (
            "measured: {gain_db: 42 V, gbw_hz: 1 MHz, phase_margin_deg: 60}",
            "measured.gain_db: must be a number, alone or with a unit of dB, got '42 V'",
        ),
        (
            "measured: {gain_db: 42, gbw_hz: 0.1, phase_margin_deg: 60}",
            "measured.gbw_hz: must be in [1, 1e+12] Hz, got 0.1; meant in kHz? ",
        ),
        (
            "measured: {gain_db: 42, gbw_hz: 1 MHz, phase_margin_deg: 180}",
            "measured.phase_margin_deg: must be a number in [-85, 179], got 180",
        ),
        (
            "measured: {gain_db: 42, gbw_hz: 1 MHz, phase_margin_deg: 60, bandwidth_hz: 1 V}",
            "measured.bandwidth_hz: must be a number, alone or with a unit of Hz, kHz, MHz, GHz, mHz, got '1 V'",
        ),
        (
            "measured: {gain_db: 42, gbw_hz: 1 MHz, phase_margin_deg: 60, falling_slew_v_per_s: 1e6}",
            "measured: slew_v_per_s must be given where falling_slew_v_per_s is",
        ),
        (
            "measured: {gain_db: 42, gbw_hz: 1 MHz, phase_margin_deg: 60, slew: 1}",
            "measured.slew: unknown key",
        ),
        (
            "output_width: 240 um\nmeasured: {gain_db: 120 dB, gbw_hz: 1 MHz, phase_margin_deg: 60}",
            "measured: gain_db, gbw_hz and phase_margin_deg must be reachable by load and compensation of this "
            "circuit, got 1e+06 (120 dB), 1e+06 Hz and 60 degrees",
        ),
        (
            "stages: 1\nmeasured: {gain_db: 42, gbw_hz: 1 MHz, phase_margin_deg: 60, bandwidth_hz: 1 MHz}",
            "measured: bandwidth_hz must be left out with one stage",
        ),
        (
            "tolerance: {threshold_mismatch: 45}",
            "tolerance.threshold_mismatch: must be in [0, 1e-06] V m, got 45; meant in mV um?",
        ),
        (
            "gain_mismatch: 0.02 um\ntolerance: {gain_mismatch: 0.02 um}",
            "tolerance.gain_mismatch: must be given once: it is a key of the design, too",
        ),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    assert refused(tmp_path, text).startswith(message)


@pytest.mark.parametrize(
    ("stages", "figures", "adjusted"),
    [
        (2, (45.0, 2e6, 55.0), {"load_resistance", "compensation", "load_capacitance"}),
        (1, (38.0, 1.2e6, 62.0), {"channel_length_modulation", "compensation", "load_capacitance"}),
    ],
)
def test_a_design_has_the_figures_that_were_measured(
    tmp_path: Path, stages: int, figures: tuple[float, float, float], adjusted: set[str]
) -> None:
    gain, crossing, margin = figures
    loaded = load(
        tmp_path,
        f"stages: {stages}\nfilm_geometry: as in paper\nzero_resistor: 2 kohm\n"
        f"measured: {{gain_db: {gain}, gbw_hz: {crossing / 1e6} MHz, phase_margin_deg: {margin}}}\n",
    )
    assert set(loaded.adjusted) == adjusted
    for key, value in loaded.adjusted.items():
        assert getattr(loaded.design, key) == value
    assert loaded.design.zero_resistor == 2e3
    found = report.values(loaded.design, ("gain_db", "gbw_hz", "phase_margin_deg"))
    assert found == pytest.approx({"gain_db": gain, "gbw_hz": crossing, "phase_margin_deg": margin}, rel=1e-5)


def test_without_measured_figures_nothing_is_adjusted(tmp_path: Path) -> None:
    assert load(tmp_path, "stages: 2\n").adjusted == {}


def test_sweep_and_tolerance_of_a_file(tmp_path: Path) -> None:
    loaded = load(
        tmp_path,
        "sweep:\n  - {field: film_thickness, from: 1 um, to: 4 um, points: 3, log: true}\n"
        "  - {field: supply, from: 4, to: 5, points: 2}\n"
        "tolerance:\n  samples: 10\n  seed: 7\n  threshold_mismatch: 10 mV um\n  gain_mismatch: 0.01 um\n"
        "  spread: {film_area: 5 %}\n  limits: {gain_db: {min: 40}, offset_v: {max: 0.001}}\n",
    )
    assert loaded.sweep is not None
    fields = loaded.sweep.fields()
    assert fields["film_thickness"] == pytest.approx([1e-6, 1e-6, 2e-6, 2e-6, 4e-6, 4e-6], rel=1e-12)
    assert fields["supply"].tolist() == [4, 5, 4, 5, 4, 5]
    tolerance = loaded.tolerance
    assert tolerance is not None
    assert (tolerance.samples, tolerance.seed, tolerance.spread) == (10, 7, (("film_area", 0.05),))
    assert (loaded.design.threshold_mismatch, loaded.design.gain_mismatch) == pytest.approx((1e-8, 1e-8), rel=1e-15)
    assert [(limit.key, limit.low, limit.high) for limit in tolerance.limits] == [
        ("gain_db", 40, math.inf),
        ("offset_v", -math.inf, 0.001),
    ]
    assert load(tmp_path, "tolerance: {samples: 5}").tolerance == Tolerance(samples=5)


def test_every_circuit_of_the_comparison_with_spice_is_shipped_as_a_design() -> None:
    assert set(shipped()) == {*CIRCUITS, "paper", "square_millimetre"}

    def numbers(text: str) -> list[Any]:
        def value(word: str) -> Any:
            try:
                return pytest.approx(float(word), rel=1e-8)
            except ValueError:
                return word

        return [value(part) for word in text.split() for part in word.strip("()").split("=")]

    with each_row() as row:
        for name, circuit in CIRCUITS.items():
            with row(name):
                design = load_design(name).design
                assert design.stages == circuit.stages
                assert numbers(design.netlist(name)) == numbers(subcircuit(circuit))


def test_the_papers_file_states_the_papers_values() -> None:
    paper, usual = load_design("paper").design, PosfetDesign(film_geometry=FilmGeometry.AS_IN_PAPER)
    for name in plausible_fields(PosfetDesign):
        assert getattr(paper, name) == pytest.approx(getattr(usual, name), rel=1e-12, abs=0), name
    assert load_design("square_millimetre").design.coupling == PosfetDesign().coupling


def test_an_unknown_name_says_what_lists_the_shipped_designs() -> None:
    with pytest.raises(
        ConfigError, match=r"^nothing: no such design; .* a shipped design \(listed by posfet design --list\)$"
    ):
        load_design("nothing")
    assert {path.suffix for path in FOLDER.iterdir()} == {".yaml"}


def fields_table() -> list[tuple[str, str, str, str, str]]:
    """Return the keys of a design file: key, default, unit, plausible range, meaning with its source."""
    rows = []
    for item in dataclasses.fields(PosfetDesign):
        if "quantity" not in item.metadata:
            continue
        of, plausible = item.metadata["quantity"], item.metadata["plausible"]
        span = f"{'+-' if plausible.signed else ''}{plausible.low:g} to {plausible.high:g}"
        source = f"{'assumed: ' if of.assumed else ''}{of.source}"
        rows.append((item.name, f"{of.value:.6g}", of.unit, span, f"{of.name} ({source})"))
    return rows


def test_every_key_is_documented_with_default_unit_and_range() -> None:
    text = (DOCS / "design.md").read_text(encoding="utf-8")
    rows = fields_table()
    assert {row[0] for row in rows} == set(plausible_fields(PosfetDesign))
    for key, default, unit, span, meaning in rows:
        assert f"| `{key}` | {default} | {unit} | {span} | {meaning} |" in text, key


def test_the_complete_example_of_the_document_has_every_key_and_is_of_the_default(tmp_path: Path) -> None:
    example, tolerance = re.findall(r"```yaml\n(.*?)```", (DOCS / "design.md").read_text(encoding="utf-8"), re.DOTALL)
    besides = {"stages", "film_geometry", "poling_voltages", "sweep", "tolerance"}
    assert set(re.findall(r"^(\w+):", example, re.MULTILINE)) == set(plausible_fields(PosfetDesign)) | besides
    loaded, default = load(tmp_path, example), PosfetDesign()
    for name in plausible_fields(PosfetDesign):
        assert getattr(loaded.design, name) == pytest.approx(getattr(default, name), rel=0.02), name
    assert loaded.design.poled_fraction == pytest.approx(0.84, abs=0.005)
    assert loaded.design.valid
    assert loaded.sweep is not None
    assert run_sweep(loaded.design, loaded.sweep).valid.any()
    assert loaded.tolerance is not None
    assert 0 < run_tolerance(loaded.design, loaded.tolerance).yielded <= 1
    assert load(tmp_path, tolerance).tolerance is not None


@pytest.mark.parametrize("text", ["", "# nothing yet\n", "---\n"])
def test_an_empty_file_is_the_design_of_the_defaults(tmp_path: Path, text: str) -> None:
    loaded = load(tmp_path, text)
    assert all(getattr(loaded.design, name) == getattr(PosfetDesign(), name) for name in plausible_fields(PosfetDesign))
    assert loaded.sweep is loaded.tolerance is None
