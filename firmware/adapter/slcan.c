// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "slcan.h"

#include <string.h>

static const char digits[] = "0123456789ABCDEF";
static const uint8_t lengths[16] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};

enum { STANDARD_DIGITS = 3, EXTENDED_DIGITS = 8, HIGHEST_CLASSIC_CODE = 8 };

static unsigned code_of(uint8_t length) {
    unsigned code = 0;
    while (code < 15 && lengths[code] < length)
        code++;
    return code;
}

size_t posfet_slcan_format(const posfet_frame *frame, char line[POSFET_SLCAN_LINE]) {
    const bool extended = (frame->flags & POSFET_EXTENDED) != 0;
    char letter = 't';
    if (frame->flags & POSFET_REMOTE) letter = 'r';
    if (frame->flags & POSFET_FD) letter = frame->flags & POSFET_RATE_SWITCH ? 'b' : 'd';
    char *end = line;
    *end++ = extended ? (char)(letter - 'a' + 'A') : letter;
    for (unsigned digit = extended ? EXTENDED_DIGITS : STANDARD_DIGITS; digit-- > 0;)
        *end++ = digits[frame->id >> 4U * digit & 0x0FU];
    *end++ = digits[code_of(frame->length)];
    if (!(frame->flags & POSFET_REMOTE)) {
        for (unsigned i = 0; i < frame->length; i++) {
            *end++ = digits[frame->data[i] >> 4];
            *end++ = digits[frame->data[i] & 0x0FU];
        }
    }
    *end++ = '\r';
    return (size_t)(end - line);
}

static bool read_digit(char digit, uint8_t *value) {
    if (digit >= '0' && digit <= '9')
        *value = (uint8_t)(digit - '0');
    else if (digit >= 'A' && digit <= 'F')
        *value = (uint8_t)(digit - 'A' + 10);
    else if (digit >= 'a' && digit <= 'f')
        *value = (uint8_t)(digit - 'a' + 10);
    else
        return false;
    return true;
}

static bool read_kind(char letter, uint8_t *flags) {
    const bool extended = letter < 'a';
    switch (extended ? letter - 'A' + 'a' : letter) {
    case 't': *flags = 0; break;
    case 'r': *flags = POSFET_REMOTE; break;
    case 'd': *flags = POSFET_FD; break;
    case 'b': *flags = POSFET_FD | POSFET_RATE_SWITCH; break;
    default: return false;
    }
    if (extended) *flags |= POSFET_EXTENDED;
    return true;
}

bool posfet_slcan_parse(const char *line, size_t length, posfet_frame *frame) {
    memset(frame, 0, sizeof *frame);
    if (length == 0 || !read_kind(line[0], &frame->flags)) return false;
    const bool extended = (frame->flags & POSFET_EXTENDED) != 0;
    const size_t header = 2U + (extended ? EXTENDED_DIGITS : STANDARD_DIGITS);
    if (length < header) return false;
    uint8_t value = 0;
    for (size_t i = 1; i < header - 1; i++) {
        if (!read_digit(line[i], &value)) return false;
        frame->id = frame->id << 4 | value;
    }
    if (frame->id > (extended ? 0x1FFFFFFFU : 0x7FFU)) return false;
    uint8_t code = 0;
    if (!read_digit(line[header - 1], &code)) return false;
    if (!(frame->flags & POSFET_FD) && code > HIGHEST_CLASSIC_CODE) return false;
    frame->length = lengths[code];
    if (frame->flags & POSFET_REMOTE) return length == header;
    if (length != header + 2U * frame->length) return false;
    for (size_t i = 0; i < frame->length; i++) {
        uint8_t high = 0;
        uint8_t low = 0;
        if (!read_digit(line[header + 2 * i], &high) || !read_digit(line[header + 2 * i + 1], &low)) return false;
        frame->data[i] = (uint8_t)(high << 4 | low);
    }
    return true;
}

void posfet_slcan_init(posfet_slcan *adapter) {
    memset(adapter, 0, sizeof *adapter);
}

static const char *run_setting(posfet_slcan *adapter) {
    static const char accepted[] = "\r";
    static const char refused[] = "\a";
    const char letter = adapter->line[0];
    const bool alone = adapter->length == 1;
    switch (letter) {
    case 'O':
    case 'L':
        if (!alone || adapter->open) return refused;
        adapter->open = true;
        adapter->listen_only = letter == 'L';
        return accepted;
    case 'C': adapter->open = false; return alone ? accepted : refused;
    case 'S': // bit rates have no meaning without wires
    case 'Y': return adapter->length == 2 && !adapter->open ? accepted : refused;
    case 'V': return alone ? "V0200\r" : refused;
    case 'N': return alone ? "N0001\r" : refused;
    case 'F': return alone && adapter->open ? "F00\r" : refused;
    default: return refused;
    }
}

static enum posfet_slcan_event run_line(posfet_slcan *adapter) {
    if (adapter->length == 0) { // an empty line: hosts send some to end what an earlier one may have left
        adapter->reply = "\r";
        return POSFET_SLCAN_REPLY;
    }
    if (adapter->length <= sizeof adapter->line &&
        posfet_slcan_parse(adapter->line, adapter->length, &adapter->frame)) {
        if (adapter->open && !adapter->listen_only) {
            adapter->reply = adapter->frame.flags & POSFET_EXTENDED ? "Z\r" : "z\r";
            return POSFET_SLCAN_SEND;
        }
        adapter->reply = "\a";
        return POSFET_SLCAN_REPLY;
    }
    adapter->reply = run_setting(adapter);
    return POSFET_SLCAN_REPLY;
}

enum posfet_slcan_event posfet_slcan_take(posfet_slcan *adapter, char byte) {
    if (byte == '\n') return POSFET_SLCAN_NOTHING; // some hosts end lines with both
    if (byte != '\r') {
        // A line that is too long stays too long, so that its beginning is not taken for a line.
        if (adapter->length < sizeof adapter->line) adapter->line[adapter->length] = byte;
        if (adapter->length <= sizeof adapter->line) adapter->length++;
        return POSFET_SLCAN_NOTHING;
    }
    const enum posfet_slcan_event event = run_line(adapter);
    adapter->length = 0;
    return event;
}
