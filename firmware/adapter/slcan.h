// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// A serial CAN adapter's text protocol (slcan, LAWICEL's CAN232 with CANable's FD letters), for a board that is reached
// through a serial line. It knows frames and lines, no board and no line driver.
#ifndef POSFET_SLCAN_H
#define POSFET_SLCAN_H

#include "posfet_frame.h"

#include <stdbool.h>
#include <stddef.h>

// Longest line: letter, 8 digits of the identifier, length code, 64 bytes as digits, end of line.
enum { POSFET_SLCAN_LINE = 1 + 8 + 1 + 2 * POSFET_DATA_BYTES + 1 };

enum posfet_slcan_event {
    POSFET_SLCAN_NOTHING,
    POSFET_SLCAN_REPLY, // `reply` is to be sent
    POSFET_SLCAN_SEND,  // the same, and `frame` is for the bus
};

typedef struct {
    bool open;        // frames of the bus are passed to the host
    bool listen_only; //
    const char *reply;
    posfet_frame frame;
    size_t length;
    char line[POSFET_SLCAN_LINE];
} posfet_slcan;

void posfet_slcan_init(posfet_slcan *adapter);

// Take one byte from the host.
enum posfet_slcan_event posfet_slcan_take(posfet_slcan *adapter, char byte);

// Write the line of a frame with its end, without a final zero. Returns its length.
size_t posfet_slcan_format(const posfet_frame *frame, char line[POSFET_SLCAN_LINE]);

// Read a line without its end. False: it is no frame.
bool posfet_slcan_parse(const char *line, size_t length, posfet_frame *frame);

#endif
