# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Which requests the browser view answers: those of its own page, with the token of its link."""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

TOKEN_HEADER: Final = "X-Posfet-Token"


@dataclass(frozen=True)
class Guard:
    """Checks where a request comes from.

    A page of another site cannot read what it asks for, but it can ask, under a host name of its own that it lets
    point to this machine: so the header Host must name this machine, Origin, where a browser sends it, this server, and
    everything but the files of the page needs the token, which other users of this machine do not know either.
    """

    port: int
    token: str

    @property
    def hosts(self) -> tuple[str, ...]:
        """Allowed values of the header Host."""
        return f"127.0.0.1:{self.port}", f"localhost:{self.port}"

    def refusal(self, headers: Mapping[str, str], token: str, token_needed: bool) -> str:
        """Return why a request is refused, in one line; '' if it is not.

        Parameters
        ----------
        headers : mapping of str to str
            Headers of the request.
        token : str
            Token that came with it.
        token_needed : bool
            Whether it needs the token.
        """
        if headers.get("Host", "") not in self.hosts:
            return f"wrong Host: open http://{self.hosts[0]} on this machine, or through an SSH tunnel to this port"
        if headers.get("Origin", f"http://{self.hosts[0]}") not in {f"http://{host}" for host in self.hosts}:
            return "wrong Origin: only the page of this server may ask"
        if token_needed and not hmac.compare_digest(token.encode(), self.token.encode()):
            return "wrong token: open the link that posfet printed"
        return ""
