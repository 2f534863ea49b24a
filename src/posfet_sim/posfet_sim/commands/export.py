# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet export`: a recording as arrays or tables for learning."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from posfet_model.command_line import BAD_INPUT
from posfet_model.config import ConfigError
from posfet_sim.commands.progress import progress
from posfet_sim.recording.export import FORMATS, Export


def main(words: Sequence[str] | None = None) -> int:
    """Write a recording in another format.

    Parameters
    ----------
    words : sequence of str, optional
        Command line; default: that of the process.

    Returns
    -------
    int
        0, also if the recording is damaged: what is missing is said in one line on stderr; 1, with one line on stderr,
        for bad input.
    """
    options = make_parser().parse_args(words)
    try:
        write = FORMATS.get(options.out.suffix)
        if write is None:
            raise ConfigError(f"{options.out}: must end in {', '.join(FORMATS)}")
        export = Export(options.recording, options.topics)
        with progress(options.recording.name, export.recording.size) as at:
            paths = write(options.out, export, at)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(f"{error.filename or options.out}: cannot be written: {error.strerror or error}", file=sys.stderr)
        return BAD_INPUT
    for problem in export.problems:
        print(problem, file=sys.stderr)
    for path in paths:
        print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
    return 0


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet export`."""
    parser = argparse.ArgumentParser(
        prog="posfet export",
        description="Write a recording as arrays or tables: NumPy, HDF5 (h5py), Parquet (pyarrow).",
    )
    parser.add_argument(
        "recording", metavar="RECORDING", type=Path, help="an MCAP file of posfet record, posfet sim or ros2 bag"
    )
    parser.add_argument(
        "out", metavar="FILE", type=Path, help=f"file to write: {', '.join(FORMATS)}; Parquet: one for each topic"
    )
    parser.add_argument(
        "--topics", nargs="+", metavar="TOPIC", default=(), help="topics to export, such as raw contacts (default: all)"
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
