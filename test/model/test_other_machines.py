# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The reference tables are also reproduced with the elementary functions that other processors use.

SIMD levels can be disabled in NumPy and libm, so that a machine with AVX-512 gives the results of one without it.
"""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys

import pytest

from support import machine
from support.paths import ROOT

TABLES = [
    f"test/model/{room}/test_{name}.py"
    for room, names in {
        "amplifier": ("operating_point", "differential_pair", "follower"),
        "device": ("charge", "film", "mechanics", "noise", "transistor"),
    }.items()
    for name in names
]
CHOSEN = "40_digit or error_per_region or beside_the_edges"

AVX512 = [name for name in machine.dispatched() if name.startswith("AVX512") or name == "X86_V4"]
AVX2 = [*AVX512, *(name for name in machine.dispatched() if name in ("AVX2", "FMA3", "X86_V3"))]
# glibc 2.33 and later, and before.
PLAIN_LIBM = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX2_Usable,-FMA_Usable,-FMA4_Usable"}


def _report(environment: dict[str, str], *plugins: str) -> str:
    """Return the report of the tests of the tables in a separate process; fail if they fail."""
    path = os.pathsep.join([str(ROOT / "test"), *filter(None, [os.environ.get("PYTHONPATH")])])
    chosen = [argument for plugin in plugins for argument in ("-p", plugin)]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *chosen, "-p", "no:cacheprovider", "--tb=short", "-k", CHOSEN, *TABLES],
        cwd=ROOT,
        env={**os.environ, **environment, "PYTHONPATH": path, "PYTEST_ADDOPTS": ""},  # colcon sets options
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    passed = re.search(r"(\d+) passed", run.stdout)
    assert passed is not None and int(passed[1]) >= len(TABLES), run.stdout
    return run.stdout


@pytest.mark.parametrize(
    ("forbidden", "libm"),
    [
        pytest.param(AVX512, {}, id="NumPy without AVX-512"),
        pytest.param(AVX2, {}, id="NumPy without AVX-512 and AVX2", marks=pytest.mark.slow),
        pytest.param([], PLAIN_LIBM, id="libm without FMA and AVX2", marks=pytest.mark.slow),
        pytest.param(AVX512, PLAIN_LIBM, id="NumPy without AVX-512, libm without FMA and AVX2", marks=pytest.mark.slow),
        pytest.param(AVX2, PLAIN_LIBM, id="NumPy and libm without AVX-512, FMA and AVX2"),
    ],
)
def test_tables_are_reproduced_without_the_newer_instructions(
    forbidden: list[str], libm: dict[str, str], record_property
) -> None:
    missed = [name for name in forbidden if not machine.offers(name)]
    if not libm and len(missed) == len(forbidden):
        pytest.skip("NumPy finds none of these instructions here: the other tests run without them")
    if libm and "GLIBC_TUNABLES" in os.environ:
        pytest.skip("GLIBC_TUNABLES is set: the caller has chosen libm's functions")
    if libm and platform.libc_ver()[0] != "glibc":
        pytest.skip("this C library is not glibc: its use of instructions cannot be restricted")
    if libm and not (machine.offers("FMA3") and machine.offers("AVX2")):
        pytest.skip("no FMA and AVX2 here: libm does not use them")
    environment = {**libm}
    if forbidden:
        environment["NPY_DISABLE_CPU_FEATURES"] = " ".join(forbidden)
    usual, found = machine.choice(), machine.read(_report(environment, "support.machine"))
    record_property("in effect", str(found))
    print(f"in effect: {found}; usual: {usual}")
    assert not set(forbidden) & set(found.features)
    if len(missed) < len(forbidden):
        assert found.numpy != usual.numpy, "NumPy gives the same bits: the names of its features have changed"
    if libm:
        assert found.libm != usual.libm, "libm gives the same bits: the names of its tunables have changed"


@pytest.mark.slow
@pytest.mark.parametrize("seed", ["0", "1"])
def test_tables_are_reproduced_with_functions_at_the_allowed_error(seed: str, record_property) -> None:
    """For every machine, also those that no variable can emulate; see `support.inexact`."""
    found = machine.read(_report({"INEXACT_SEED": seed}, "support.inexact", "support.machine"))
    record_property("in effect", str(found))
    usual = machine.choice()
    assert found.numpy != usual.numpy and found.libm != usual.libm
