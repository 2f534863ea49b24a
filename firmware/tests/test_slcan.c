// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// The serial adapter: lines to frames and back, settings, and bytes that are no line.
#include "check.h"
#include "slcan.h"

#include <string.h>

static uint32_t random_state = 1;

static uint32_t random_number(void) {
    random_state = random_state * 1664525U + 1013904223U;
    return random_state >> 8;
}

static bool parse(const char *line, posfet_frame *frame) {
    return posfet_slcan_parse(line, strlen(line), frame);
}

static void lines_and_frames_are_equivalent(void) {
    static const uint8_t lengths[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    static const uint8_t kinds[] = {0, POSFET_REMOTE, POSFET_FD, POSFET_FD | POSFET_RATE_SWITCH};
    for (unsigned round = 0; round < 20000; round++) {
        posfet_frame frame;
        memset(&frame, 0, sizeof frame);
        const bool extended = random_number() & 1U;
        frame.flags = (uint8_t)(kinds[random_number() % 4] | (extended ? POSFET_EXTENDED : 0));
        frame.id = (random_number() << 8 ^ random_number()) & (extended ? 0x1FFFFFFFU : 0x7FFU);
        frame.length = lengths[random_number() % (frame.flags & POSFET_FD ? 16U : 9U)];
        if (!(frame.flags & POSFET_REMOTE))
            for (unsigned i = 0; i < frame.length; i++)
                frame.data[i] = (uint8_t)(random_number() & 255U);
        char line[POSFET_SLCAN_LINE];
        const size_t length = posfet_slcan_format(&frame, line);
        CHECK(length <= sizeof line && line[length - 1] == '\r');
        posfet_frame back;
        CHECK(posfet_slcan_parse(line, length - 1, &back));
        CHECK(memcmp(&frame, &back, sizeof frame) == 0);
    }
    char line[POSFET_SLCAN_LINE];
    posfet_frame frame = {.id = 0x100, .length = 2, .data = {0xAB, 0x01}};
    CHECK(memcmp(line, "t1002AB01\r", posfet_slcan_format(&frame, line)) == 0);
    frame = (posfet_frame){.id = 0x1ABCDEF0, .flags = POSFET_EXTENDED | POSFET_FD | POSFET_RATE_SWITCH, .length = 12};
    CHECK(memcmp(line, "B1ABCDEF09000000000000000000000000\r", posfet_slcan_format(&frame, line)) == 0);
}

static void malformed_lines_are_no_frames(void) {
    static const char *const lines[] = {"",           "t",      "t100",    "t1001",   "t10010", "t100100 ",
                                        "t1001000",   "t8000",  "t1009",   "tG000",   "t-100",  "x1000",
                                        "T200000000", "r10010", "d100F00", "t1001G0", "O"};
    posfet_frame frame;
    for (unsigned i = 0; i < sizeof lines / sizeof *lines; i++)
        CHECK(!parse(lines[i], &frame));
    CHECK(parse("t7ff1aB", &frame) && frame.id == 0x7FF && frame.data[0] == 0xAB);
    CHECK(parse("r1008", &frame) && frame.length == 8 && frame.flags == POSFET_REMOTE);
}

static posfet_slcan adapter;

// Replies to some lines, one after the other.
static void check_replies(const char *input, const char *wanted) {
    char replies[256] = "";
    for (const char *byte = input; *byte; byte++)
        if (posfet_slcan_take(&adapter, *byte) != POSFET_SLCAN_NOTHING) {
            CHECK(strlen(replies) + strlen(adapter.reply) < sizeof replies);
            strcat(replies, adapter.reply);
        }
    if (strcmp(replies, wanted) != 0) {
        fprintf(stderr, "replies to %s are not as wanted\n", input);
        exit(1);
    }
}

static void the_channel_opens_and_closes(void) {
    posfet_slcan_init(&adapter);
    check_replies("C\rS8\rY5\r", "\r\r\r");
    check_replies("t1000\r", "\a");
    CHECK(!adapter.open);
    check_replies("O\rO\rS8\r", "\r\a\a");
    CHECK(adapter.open);
    check_replies("t1000\r\nT000001000\rV\rN\rF\r\r", "z\rZ\rV0200\rN0001\rF00\r\r");
    check_replies("q\rOO\rt100\rC1\r", "\a\a\a\a");
    check_replies("C\rL\rt1000\r", "\r\r\a");
    check_replies("C\rF\rS\r", "\r\a\a");
}

static void frames_reach_the_bus_from_an_open_channel(void) {
    posfet_slcan_init(&adapter);
    const char *line = "O\rt10080107000000000000\r";
    enum posfet_slcan_event event = POSFET_SLCAN_NOTHING;
    for (; *line; line++)
        event = posfet_slcan_take(&adapter, *line);
    CHECK_EQUAL(event, POSFET_SLCAN_SEND);
    CHECK_EQUAL(adapter.frame.id, 0x100);
    CHECK_EQUAL(adapter.frame.data[1], 7);
}

static void a_line_that_is_too_long_is_refused_once(void) {
    posfet_slcan_init(&adapter);
    check_replies("O\r", "\r");
    for (unsigned i = 0; i < 1000; i++)
        CHECK_EQUAL(posfet_slcan_take(&adapter, i == 0 ? 't' : '1'), POSFET_SLCAN_NOTHING);
    check_replies("\rt1000\r", "\az\r");
}

static void any_bytes_are_survived(void) {
    static const char likely[] = "tTrRdDbBOCLSYF0123456789ABCDEFabcdef\r\r\r\n";
    posfet_slcan_init(&adapter);
    unsigned frames = 0;
    for (unsigned i = 0; i < 2000000; i++) {
        const char byte =
            random_number() % 64 ? likely[random_number() % (sizeof likely - 1)] : (char)(random_number() & 127U);
        if (i % 256 == 0)
            adapter.open = true, adapter.listen_only = false; // lines by chance close it more often than they open it
        const enum posfet_slcan_event event = posfet_slcan_take(&adapter, byte);
        CHECK(event == POSFET_SLCAN_NOTHING || strlen(adapter.reply) > 0);
        if (event == POSFET_SLCAN_SEND) frames++;
    }
    CHECK(frames > 0);
}

int main(void) {
    RUN(lines_and_frames_are_equivalent);
    RUN(malformed_lines_are_no_frames);
    RUN(the_channel_opens_and_closes);
    RUN(frames_reach_the_bus_from_an_open_channel);
    RUN(a_line_that_is_too_long_is_refused_once);
    RUN(any_bytes_are_survived);
    return 0;
}
