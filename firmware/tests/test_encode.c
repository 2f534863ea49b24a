// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Frames against bytes that were derived by hand from the tables of docs/protocol.md.
#include "check.h"
#include "posfet_encode.h"

#include <string.h>

static void check_frame(const posfet_frame *frame, uint32_t id, unsigned flags, const char *digits) {
    CHECK_EQUAL(frame->id, id);
    CHECK_EQUAL(frame->flags, flags);
    CHECK_EQUAL(2U * frame->length, strlen(digits));
    for (unsigned i = 0; i < frame->length; i++) {
        char text[3];
        snprintf(text, sizeof text, "%02X", (unsigned)frame->data[i]);
        if (strncmp(text, digits + 2 * i, 2) != 0) {
            fprintf(stderr, "identifier %03X, byte %u: %s in place of %.2s\n", (unsigned)id, i, text, digits + 2 * i);
            exit(1);
        }
    }
}

static void the_checksum_has_its_published_check_value(void) {
    CHECK_EQUAL(posfet_crc16(POSFET_CRC_INITIAL, (const uint8_t *)"123456789", 9), 0x29B1);
    const uint16_t begun = posfet_crc16(POSFET_CRC_INITIAL, (const uint8_t *)"1234", 4);
    CHECK_EQUAL(posfet_crc16(begun, (const uint8_t *)"56789", 5), 0x29B1);
}

// Bit by bit, as the polynomial is defined.
static uint16_t slow_crc(const uint8_t *bytes, size_t count) {
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < count; i++) {
        crc = (uint16_t)(crc ^ bytes[i] << 8);
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)(crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1);
    }
    return crc;
}

static void an_fd_block_has_every_field_in_its_place(void) {
    uint16_t counts[30];
    for (unsigned i = 0; i < 30; i++)
        counts[i] = (uint16_t)(0x0102 + 0x0202 * i);
    posfet_scan scan = {
        .sequence = 0x89ABCDEF, .time_us = 0x7700112233, .flags = 0x0A, .boot = 0x1C, .taxels = 30, .counts = counts};
    posfet_frame frame;
    memset(&frame, 0xFF, sizeof frame); // of another frame that had its place in the queue
    posfet_encode_fd_block(&frame, 0x120, true, &scan, 1);
    uint8_t covered[62];
    memcpy(covered, frame.data, 10);
    memcpy(covered + 10, frame.data + 12, 52);
    CHECK_EQUAL(frame.data[10] | frame.data[11] << 8, slow_crc(covered, sizeof covered));
    frame.data[10] = frame.data[11] = 0;
    check_frame(&frame, 0x123, POSFET_FD | POSFET_RATE_SWITCH,
                "EFCDAB89"
                "33221100"
                "01"
                "CA"
                "0000"
                "3635"
                "3837"
                "3A39"
                "3C3B"
                "0000000000000000000000000000000000000000000000000000000000000000000000000000000000000000");
    posfet_encode_fd_block(&frame, 0x120, false, &scan, 0);
    CHECK_EQUAL(frame.flags, POSFET_FD);
    CHECK_EQUAL(frame.data[12] | frame.data[13] << 8, 0x0102);
    CHECK_EQUAL(frame.data[62] | frame.data[63] << 8, 0x0102 + 0x0202 * 25);
}

static void classic_frames_have_every_field_in_its_place(void) {
    const uint16_t counts[7] = {0x1234, 0x5678, 0x9ABC, 0xDEF0, 0xFFFF, 0x800F, 0x0010};
    const posfet_scan scan = {
        .sequence = 0xFEDCBA97, .time_us = 0x9C7654321, .boot = 0x1B, .taxels = 7, .counts = counts};
    posfet_frame frame;
    memset(&frame, 0xFF, sizeof frame); // of another frame that had its place in the queue
    posfet_encode_header(&frame, 0x100, &scan);
    check_frame(&frame, 0x104, 0,
                "97BADCFE"
                "214365B7");
    // 12 bits each: 7, 123, 567, 9AB, DEF, FFF from the lowest
    posfet_encode_classic_block(&frame, 0x100, &scan, 0);
    check_frame(&frame, 0x108, 0,
                "37"
                "12"
                "67"
                "B5"
                "9A"
                "EF"
                "FD"
                "FF");
    posfet_encode_classic_block(&frame, 0x100, &scan, 1);
    check_frame(&frame, 0x109, 0,
                "07"
                "80"
                "01"
                "00"
                "00"
                "00"
                "00"
                "00");
}

static void status_identity_and_response_have_every_field_in_their_places(void) {
    posfet_frame frame;
    memset(&frame, 0xFF, sizeof frame); // of another frame that had its place in the queue
    const posfet_status status = {.temperatures = {-256, 25 * 256 + 128},
                                  .supply_mv = 3300,
                                  .flags = 0x0D,
                                  .scanning = true,
                                  .boot = 0x15,
                                  .heartbeat = 0x2E};
    posfet_encode_status(&frame, 0x7F0, &status);
    check_frame(&frame, 0x7F2, 0,
                "00FF"
                "8019"
                "E40C"
                "1D"
                "E5");
    const posfet_status unknown = {.temperatures = {POSFET_TEMPERATURE_UNKNOWN, POSFET_TEMPERATURE_UNKNOWN},
                                   .supply_mv = POSFET_SUPPLY_UNKNOWN};
    posfet_encode_status(&frame, 0x100, &unknown);
    check_frame(&frame, 0x102, 0,
                "0080"
                "0080"
                "FFFF"
                "00"
                "00");

    const posfet_identity identity = {
        .layout_id = 0x8001, .fd = true, .firmware_major = 5, .firmware_minor = 6, .period_us = 10000000};
    posfet_encode_identity(&frame, 0x100, &identity);
    check_frame(&frame, 0x105, 0,
                "0180"
                "12"
                "05"
                "06"
                "809698");
    CHECK_EQUAL(posfet_identify_value(&identity), 0x05128001);

    const posfet_response response = {
        .command = 0xC8, .tag = 0xFE, .result = POSFET_FAILED, .boot = 0x1F, .value = 0x01020304};
    posfet_encode_response(&frame, 0x100, &response);
    check_frame(&frame, 0x101, 0,
                "C8"
                "FE"
                "04"
                "0F"
                "04030201");
}

static void blocks_are_as_many_as_needed(void) {
    static const unsigned table[][3] = {{1, 1, 1},  {5, 1, 1},     {6, 1, 2},       {25, 1, 5},       {26, 1, 6},
                                        {27, 2, 6}, {256, 10, 52}, {1024, 40, 205}, {6656, 256, 1332}};
    for (unsigned i = 0; i < sizeof table / sizeof *table; i++) {
        CHECK_EQUAL(posfet_fd_blocks((uint16_t)table[i][0]), table[i][1]);
        CHECK_EQUAL(posfet_classic_blocks((uint16_t)table[i][0]), table[i][2]);
    }
}

int main(void) {
    RUN(the_checksum_has_its_published_check_value);
    RUN(an_fd_block_has_every_field_in_its_place);
    RUN(classic_frames_have_every_field_in_its_place);
    RUN(status_identity_and_response_have_every_field_in_their_places);
    RUN(blocks_are_as_many_as_needed);
    return 0;
}
