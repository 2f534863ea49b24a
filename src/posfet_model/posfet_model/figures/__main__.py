# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Draw all figures, or those named, as SVG and PNG: `python -m posfet_model.figures [NAME ...]`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

try:
    from posfet_model.figures.registry import FIGURES
    from posfet_model.figures.style import save
except ModuleNotFoundError as error:  # only the figures need matplotlib
    sys.exit(f"posfet_model.figures: needs {error.name} (pip install matplotlib)")


def main(arguments: list[str] | None = None) -> int:
    """Draw the requested figures and print the files written; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m posfet_model.figures", description="Draw the figures as SVG and PNG."
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"figures (default: all): {', '.join(FIGURES)}")
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder (default: %(default)s)")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.names if name not in FIGURES]
    if unknown:
        parser.error(f"no figure {', '.join(unknown)}; there are {', '.join(FIGURES)}")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or FIGURES:
        for path in save(FIGURES[name], options.out / name):
            print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
