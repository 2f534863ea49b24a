# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Prints the DBC files of the two invented boards of the tests: `python3 make_boards.py classic|fd`."""

from __future__ import annotations

import sys

HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: Board Host\n'


def classic() -> str:
    """Return board A: classic CAN, 29-bit identifiers, Motorola byte order, rows by multiplexer."""
    lines = [HEAD, "BO_ 2566848768 TactileRow: 8 Board"]  # 0x18FF0100 with the flag of 29-bit identifiers
    lines.append(' SG_ RowIndex M : 7|4@0+ (1,0) [0|4] "" Host')
    lines.append(' SG_ RollingCounter : 3|8@0+ (1,0) [0|255] "" Host')
    for row in range(5):
        for col in range(5):
            position = 12 + 10 * col  # in the order of transmission
            start = 8 * (position // 8) + 7 - position % 8
            lines.append(f' SG_ T{row + 1}{col + 1} m{row} : {start}|10@0+ (1,0) [0|1023] "" Host')
    lines += ["", "BO_ 2566849024 Climate: 6 Board"]  # 0x18FF0200
    lines.append(' SG_ ChipTemperature : 7|12@0+ (0.0625,-40) [-40|200] "degC" Host')
    lines.append(' SG_ BoardTemperature : 11|12@0+ (0.0625,-40) [-40|200] "degC" Host')
    lines.append(' SG_ Undervoltage : 24|1@0+ (1,0) [0|1] "" Host')
    lines.append(' SG_ Overheated : 25|1@0+ (1,0) [0|1] "" Host')
    return "\n".join(lines) + "\n"


def fd() -> str:
    """Return board B: CAN FD, little-endian, signed millivolts with an offset, no counter, time in ms of 16 bits."""
    lines = [HEAD]
    taxel = 0
    for name, identifier, taxels in (("Upper", 0x321, 15), ("Lower", 0x320, 10)):
        length = 32 if name == "Upper" else 24
        lines.append(f"\nBO_ {identifier} {name}: {length} Board")
        lines.append(' SG_ Uptime : 0|16@1+ (1,0) [0|65535] "ms" Host')
        for place in range(taxels):
            lines.append(f' SG_ Voltage{taxel:02} : {16 + 16 * place}|16@1- (0.25,100) [-4000|4200] "mV" Host')
            taxel += 1
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write({"classic": classic, "fd": fd}[sys.argv[1]]())
