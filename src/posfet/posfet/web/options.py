# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Command-line options of the browser view."""

from __future__ import annotations

import argparse
from typing import Final

from posfet_model._lib.shown import shown
from posfet_model.config import ConfigError

HIGHEST_PORT: Final = 65535


def add_web_arguments(parser: argparse.ArgumentParser) -> None:
    """Add `--web` and `--web-port` to a command line.

    Parameters
    ----------
    parser : ArgumentParser
        The command line.
    """
    parser.add_argument("--web", action="store_true", help="show it in a browser on this machine as well")
    parser.add_argument(
        "--web-port", type=_port, metavar="PORT", help="the same at this port (default: that of the last time, or any)"
    )


def chosen_port(options: argparse.Namespace) -> int | None:
    """Return the port of parsed options: 0 for any, None without a browser view."""
    if options.web_port is not None:
        return int(options.web_port)
    return 0 if options.web else None


def web_words(web: str) -> list[str]:
    """Return the options for a value of the launch argument `web`; raise ConfigError, one line, for any other text.

    Parameters
    ----------
    web : str
        ``true``, ``false`` or a port.
    """
    if web in ("true", "false"):
        return ["--web"] if web == "true" else []
    if not _is_port(web):
        raise ConfigError(f"web: must be true, false or a port in [1, {HIGHEST_PORT}], got {shown(web)}")
    return ["--web-port", web]


def _port(text: str) -> int:
    if not _is_port(text):
        raise argparse.ArgumentTypeError(f"must be in [1, {HIGHEST_PORT}], got '{text}'")
    return int(text)


def _is_port(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) < 6 and 0 < int(text) <= HIGHEST_PORT
