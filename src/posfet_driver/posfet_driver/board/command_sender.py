# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sends commands to a board and recognises the responses to them."""

from __future__ import annotations

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.decoder import COMMANDS_KEPT, Decoder
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Request, Response


class CommandSender:
    """Sends commands with tags: a response is accepted however late it is, for the board has done as it says.

    Parameters
    ----------
    connection : BoardConnection
        Connection to the board.
    decoder : Decoder
        Decodes the frames of the board; passes over own commands.
    base_id : int
        Base identifier of the board.
    """

    def __init__(self, connection: BoardConnection, decoder: Decoder, base_id: int) -> None:
        self._connection = connection
        self._decoder = decoder
        self._identifier = base_id + COMMAND_OFFSET
        self._tag = 0
        self._sent: dict[int, tuple[Command, int]] = {}  # command and argument by tag, in the order of sending

    def send(self, command: Command, argument: int = 0) -> int:
        """Send a command, or nothing when the bus is not open.

        Parameters
        ----------
        command : Command
            The command.
        argument : int, default 0
            Its argument.

        Returns
        -------
        int
            Its tag.
        """
        self._tag = (self._tag + 1) & 0xFF
        self._sent[self._tag] = command, argument
        if len(self._sent) > COMMANDS_KEPT:
            del self._sent[next(iter(self._sent))]
        data = Request(command, self._tag, argument).pack()
        self._decoder.sent(data)
        self._connection.write((self._identifier, CLASSIC, data))
        return self._tag

    def forget(self) -> None:
        """Expect no response to what was sent so far."""
        self._sent.clear()

    def is_own(self, response: Response) -> bool:
        """Return whether `response` belongs to one of the newest commands."""
        return response.tag in self._sent and self._sent[response.tag][0] == response.command

    def argument(self, response: Response) -> int:
        """Return the argument of the own command that `response` belongs to."""
        return self._sent[response.tag][1]
