# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Pictures of the browser view of a running bring-up: `make screenshots`, which writes those of the documents."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from support.browser import CHROMIUM, browser
from support.paths import DOCS

PICTURES = {"browser": (1400, 850, True), "browser_light": (1400, 850, False), "browser_phone": (400, 1250, True)}
"""Width, height [CSS pixels] and theme of each picture."""
HISTORY = 12.0
"""Time for the strip charts to fill [s]."""
ERROR_MODEL = "base: default\nlink: {dropped_percent: 0, truncated_percent: 0}\nboard: {resets_per_hour: 0}\n"
"""The default board but for its link, which loses a scan after 23.5 s, while the last picture is taken."""
TRIES = 10
"""Pictures that are taken until one shows both fingers."""
TWO_HELD = (
    "[...document.querySelectorAll('.contacts td:nth-child(2)')].map((cell) => cell.textContent).join() == 'held,held'"
)
"""Both fingers of the scene touch."""
SHOWN = f"{TWO_HELD} && document.body.textContent.includes('lost, 0 scans missing')"
"""They still do after the picture, and the machine was fast enough for every scan."""


def main() -> int:
    """Write the pictures and return the exit code."""
    parser = argparse.ArgumentParser(prog="make screenshots", description=__doc__)
    parser.add_argument("--out", type=Path, default=DOCS / "figures", help="folder (default: docs/figures)")
    parser.add_argument("--only", choices=PICTURES, help="one picture")
    parser.add_argument("arguments", nargs="*", default=["scene:=two_fingers"], help="arguments of posfet bringup")
    options = parser.parse_args()
    if CHROMIUM is None:
        print("chromium is missing. Install with: apt-get install chromium", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as folder:
        error_model = Path(folder) / "error_model.yaml"
        error_model.write_text(ERROR_MODEL, encoding="utf-8")
        return _take(options, [f"imperfections:={error_model}", *options.arguments])


def _take(options: argparse.Namespace, arguments: list[str]) -> int:
    """Write the pictures of a bring-up with these arguments and return the exit code."""
    command = ["posfet", "bringup", "--web", "log_level:=error", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout
        link = re.search(r"http://\S+", process.stdout.readline())
        assert link, "posfet bringup printed no link"
        for name, (width, height, dark) in PICTURES.items():
            if options.only in {None, name}:
                with browser() as page:
                    page.open(link[0], width, height, dark)
                    page.wait("document.querySelector('[data-field=validity]').textContent == 'forces valid'")
                    time.sleep(HISTORY)
                    for _ in range(TRIES):
                        page.wait(TWO_HELD)
                        page.screenshot(options.out / f"{name}.png")
                        if page.evaluate(SHOWN):  # as the picture shows, unless the machine was busy meanwhile
                            break
                    else:
                        print(
                            f"{name}: no picture in {TRIES} has both fingers and every scan: the machine is too busy",
                            file=sys.stderr,
                        )
                        return 1
                    print(f"{options.out / name}.png: written")
                    assert not page.errors, page.errors
    finally:
        process.terminate()
        process.communicate()
    return 0


if __name__ == "__main__":
    sys.exit(main())
