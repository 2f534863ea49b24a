# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""White noise, drawn and from a table, has the statistics of independent normal numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_sim.device.white_noise import TABLE_SIZE, DrawnNoise, TabulatedNoise

SCANS, BLOCKS = 64, 64
KINDS = {"drawn": (DrawnNoise, 25), "table": (TabulatedNoise, 1024)}
"""Each with a number of taxels for which it is used."""


@pytest.fixture(scope="module", params=KINDS)
def record(request: pytest.FixtureRequest) -> np.ndarray:
    """Return the noise of many blocks, shape [scans, taxels]."""
    kind, taxels = KINDS[request.param]
    noise = kind(7, SCANS, taxels)
    return np.concatenate([noise.block(number, np.ones(taxels)).copy() for number in range(BLOCKS)])


def bound(numbers: int, sigmas: float = 5.0) -> float:
    """Return what the mean of so many independent numbers of unit variance does not exceed."""
    return sigmas / math.sqrt(numbers)


def test_moments_are_those_of_a_normal_distribution(record: np.ndarray) -> None:
    # Numbers of the table are used several times: only its different ones count as independent.
    count = min(record.size, TABLE_SIZE)
    for power, expected, variance in ((1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)):
        assert (record**power).mean() == pytest.approx(expected, abs=bound(count) * math.sqrt(variance)), power


def test_tails_are_those_of_a_normal_distribution(record: np.ndarray) -> None:
    count = min(record.size, TABLE_SIZE)
    for limit in (1.0, 2.0, 3.0, 4.0):
        expected = math.erfc(limit / math.sqrt(2))
        allowed = bound(count) * math.sqrt(expected) + 2 / count
        assert (np.abs(record) > limit).mean() == pytest.approx(expected, abs=allowed), limit


def test_every_taxel_has_noise_of_its_own_size_and_mean(record: np.ndarray) -> None:
    scans, taxels = record.shape
    sigmas = 5.0 + math.sqrt(2 * math.log(taxels))  # the largest of so many
    assert np.abs(record.mean(axis=0)).max() < bound(scans, sigmas)
    assert np.abs((record**2).mean(axis=0) - 1.0).max() < bound(scans, sigmas) * math.sqrt(2)


@pytest.mark.parametrize("lag", [1, 2, 3, 16, 63, 64, 65, 200, 1024])
def test_the_noise_of_a_taxel_has_no_memory(record: np.ndarray, lag: int) -> None:
    products = (record[lag:] * record[:-lag]).mean(axis=1)  # of pairs of scans
    assert abs(products.mean()) < 5 * products.std() / math.sqrt(len(products)) + bound(record.size)
    assert np.abs(products).max() < bound(record.shape[1], 5.0 + math.sqrt(2 * math.log(len(products))))


@pytest.mark.parametrize("apart", [1, 2, 5, 24])
def test_taxels_are_independent_in_one_scan_and_over_time(record: np.ndarray, apart: int) -> None:
    for lag in (0, 1, 64):
        earlier = record[: len(record) - lag, : record.shape[1] - apart]
        product = (record[lag:, apart:] * earlier).mean()
        assert abs(product) < bound(min(earlier.size, TABLE_SIZE)), lag


def test_the_covariance_of_the_taxels_is_that_of_independent_ones() -> None:
    taxels, blocks = 600, 100
    noise = TabulatedNoise(3, SCANS, taxels)
    record = np.concatenate([noise.block(number, np.ones(taxels)).copy() for number in range(blocks)])
    values = np.linalg.eigvalsh(record.T @ record / len(record))
    spread = math.sqrt(taxels / len(record))  # Marchenko and Pastur: between (1 - spread)^2 and (1 + spread)^2
    assert (1 - spread) ** 2 - 0.1 < values[0] < values[-1] < (1 + spread) ** 2 + 0.1


def test_scans_begin_anywhere_in_the_table_and_few_share_numbers() -> None:
    taxels = 1024
    noise = TabulatedNoise(5, SCANS, taxels)
    first = np.concatenate([noise.block(number, np.ones(taxels))[:, 0].copy() for number in range(32)])
    table = noise._table[:TABLE_SIZE]
    order = np.argsort(table)
    offsets = order[np.searchsorted(table, first, sorter=order)]
    np.testing.assert_array_equal(table[offsets], first)
    assert offsets.mean() / TABLE_SIZE == pytest.approx(0.5, abs=5 / math.sqrt(12 * len(offsets)))
    apart = np.abs(offsets[:, None] - offsets)[np.triu_indices(len(offsets), 1)]
    shared = int((np.minimum(apart, TABLE_SIZE - apart) < taxels).sum())
    expected = len(apart) * 2 * taxels / TABLE_SIZE
    assert shared == pytest.approx(expected, rel=0.2)


def test_each_taxel_has_its_deviation() -> None:
    deviation = np.linspace(0.0, 3.0, 1024)
    for kind in (DrawnNoise, TabulatedNoise):
        one, wide = kind(2, SCANS, 1024), kind(2, SCANS, 1024)
        np.testing.assert_array_equal(wide.block(3, deviation), one.block(3, np.ones(1024)) * deviation)


@pytest.mark.parametrize(("kind", "taxels"), KINDS.values(), ids=KINDS)
def test_a_block_is_that_of_the_seed_whatever_is_asked_first(kind: type, taxels: int) -> None:
    ones = np.ones(taxels)
    forward, backward, other = (kind(seed, SCANS, taxels) for seed in (1, 1, 2))
    first, second = forward.block(0, ones).copy(), forward.block(10, ones).copy()
    np.testing.assert_array_equal(backward.block(10, ones), second)
    np.testing.assert_array_equal(backward.block(0, ones), first)
    assert (other.block(0, ones) != first).mean() > 0.99


def test_the_table_goes_on_at_its_beginning() -> None:
    noise = TabulatedNoise(1, SCANS, 1024)
    table = noise._table[:TABLE_SIZE]
    blocks = (noise.block(number, np.ones(1024)).copy() for number in range(200))
    found = [
        (row, at)
        for block in blocks
        for row, at in zip(block, np.argmax(block == table[-1], axis=1), strict=True)
        if at
    ]
    assert found
    for row, at in found:
        np.testing.assert_array_equal(row[at + 1 :], table[: 1023 - at])
