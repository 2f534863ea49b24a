# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Folder for what other users of this machine must not read or replace."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

from posfet_model.config import ConfigError


def private_folder() -> Path:
    """Return a folder in which no other user can make files; raise ConfigError if there is none."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime, "posfet") if runtime else Path(tempfile.gettempdir(), f"posfet-{os.getuid()}")
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError as error:
        raise ConfigError(
            f"{folder}: cannot be made: {error.strerror}; set XDG_RUNTIME_DIR to a folder of yours"
        ) from error
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o022:
        raise ConfigError(f"{folder}: must be a folder that only you can write to; set XDG_RUNTIME_DIR to another one")
    return folder
