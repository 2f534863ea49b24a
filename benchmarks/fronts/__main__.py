# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Measure every front, and write figures, results and docs/runtime_accuracy.md: `make fronts`."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from benchmarks import machine
from benchmarks.fronts import chart, page
from benchmarks.fronts.exhibit import Exhibit
from benchmarks.fronts.front import Effort, Front, FrontError
from benchmarks.fronts.legibility import check_texts
from benchmarks.fronts.palette import LIGHT, PALETTES, Palette
from posfet_model.figures import style
from posfet_model.spice import ngspice

ROOT: Final = Path(__file__).resolve().parents[2]
STAGES: Final = (
    "pipeline",
    "estimation",
    "contacts",
    "tracking",
    "compensation",
    "variants",
    "inverse",
    "crosstalk",
    "stability",
    "charge",
    "followers",
    "mechanics",
    "hysteresis",
    "laziness",
    "labelling",
    "messages",
    "noise",
)
"""Stages in the order of the document: what a reader chooses first comes first."""

FAILED: Final = "failed:"

NEEDS_NGSPICE: Final = ("followers",)


def measure_all(names: list[str], effort: Effort) -> tuple[list[Front | Exhibit], dict[str, str]]:
    """Return the verified fronts, and why a stage was not measured, by its name."""
    fronts: list[Front | Exhibit] = []
    missing = {}
    for name in names:
        if name in NEEDS_NGSPICE and not ngspice.available():
            missing[name] = f"{ngspice.PROGRAM} is not on PATH. Install with: sudo apt-get install ngspice"
            continue
        begin = time.monotonic()
        try:
            fronts += verified(name, effort)
        except (FrontError, ngspice.SpiceError) as error:
            missing[name] = f"{FAILED} {error}"
            print(f"make fronts: {error}", file=sys.stderr)
        print(f"{name}: {time.monotonic() - begin:.0f} s", flush=True)
    return fronts, missing


def verified(name: str, effort: Effort) -> list[Front | Exhibit]:
    """Return the fronts of a stage; FrontError where one contradicts theory, its table or its figure."""
    fronts = list(stage(name)(effort))
    for front in fronts:
        front.verify()
        with style.style(LIGHT.settings):  # on a dark page everything is in the same place
            figure = drawn(front, LIGHT)
            check_texts(figure, front.name)
            page.check_figure(front, figure)
    return fronts


def drawn(front: Front | Exhibit, palette: Palette) -> Figure:
    """Return the figure of a front or an exhibit."""
    return front.draw(palette) if isinstance(front, Exhibit) else chart.draw(front, palette)


def stage(name: str) -> Callable[[Effort], Sequence[Front | Exhibit]]:
    """Return the function that measures a stage."""
    found: Callable[[Effort], Sequence[Front | Exhibit]] = import_module(f"benchmarks.fronts.{name}").measure
    return found


def publish(fronts: list[Front | Exhibit], missing: dict[str, str], folder: Path, command: str) -> None:
    """Write the document, the figures and the results below a folder."""
    figures = folder / "docs" / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for front in fronts:
        for palette in PALETTES:
            stem = figures / f"{page.figure_name(front)}{palette.suffix}"
            style.save(partial(drawn, front, palette), stem, palette.settings)
    facts = machine.facts()
    page.write_results(fronts, facts, folder / "benchmarks" / "results")
    text = page.document(fronts, machine.text(), missing, command)
    (folder / "docs" / "runtime_accuracy.md").write_text(text, encoding="utf-8")


def main(words: list[str] | None = None) -> int:
    """Return 1 where a front contradicts itself; its stage is left out, and the document says why."""
    parser = argparse.ArgumentParser(prog="make fronts", description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=STAGES, metavar="STAGE", help="needs --out")
    parser.add_argument("--short", action="store_true", help="few scenes and repetitions; needs --out")
    parser.add_argument("--repeats", type=int, default=9, help="interleaved repetitions (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="folder of all files (default: this repository)")
    options = parser.parse_args(words)
    if (options.only or options.short) and options.out is None:
        parser.error("--only and --short would leave an incomplete document: name another folder with --out")
    effort = Effort(2 if options.short else options.repeats, options.short)
    begin = time.monotonic()
    fronts, missing = measure_all(options.only or list(STAGES), effort)
    publish(fronts, missing, options.out or ROOT, page.command(options.short, options.repeats))
    failed = [name for name, why in missing.items() if why.startswith(FAILED)]
    print(f"{len(fronts)} fronts, {time.monotonic() - begin:.0f} s; failed: {', '.join(failed) or 'none'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
