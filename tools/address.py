# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Where the project is found: set it here, then `python3 tools/address.py` writes it into every package."""

from __future__ import annotations

import re
from pathlib import Path

WEBSITE = "https://posfet.invalid"
"""Placeholder until there is a public address; to be set before a release."""
REPOSITORY = f"{WEBSITE}/posfet.git"
BUGTRACKER = f"{WEBSITE}/issues"
MAILBOX = "maintainers@posfet.invalid"

_RULES = (
    (r'(<url type="website">)[^<]*', WEBSITE),
    (r'(<url type="repository">)[^<]*', REPOSITORY),
    (r'(<url type="bugtracker">)[^<]*', BUGTRACKER),
    (r'(<(?:maintainer|author) email=")[^"]*', MAILBOX),
    (r'(\burl=")[^"]*', WEBSITE),
    (r'(\b(?:author|maintainer)_email=")[^"]*', MAILBOX),
)
_SOURCES = Path(__file__).resolve().parents[1] / "src"


def stale() -> dict[Path, str]:
    """Return the new text of each manifest that has another address."""
    found = {}
    for path in sorted((*_SOURCES.glob("*/package.xml"), *_SOURCES.glob("*/setup.py"))):
        text = path.read_text(encoding="utf-8")
        new = text
        for pattern, value in _RULES:
            new = re.sub(pattern, rf"\g<1>{value}", new)
        if new != text:
            found[path] = new
    return found


if __name__ == "__main__":
    for path, text in stale().items():
        path.write_text(text, encoding="utf-8")
        print(f"{path}: written")
