// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_encode.h"

#include <string.h>

enum { CLASSIC_BYTES = 8, FD_BYTES = 64, CHECKSUM_AT = 10, COUNTS_AT = 12 };

static void put_u16(uint8_t *bytes, uint16_t value) {
    bytes[0] = (uint8_t)(value & 0xFFU);
    bytes[1] = (uint8_t)(value >> 8);
}

static void put_u32(uint8_t *bytes, uint32_t value) {
    put_u16(bytes, (uint16_t)(value & 0xFFFFU));
    put_u16(bytes + 2, (uint16_t)(value >> 16));
}

uint32_t posfet_get_u32(const uint8_t bytes[4]) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

static void begin(posfet_frame *frame, uint32_t id, uint8_t flags, uint8_t length) {
    frame->id = id;
    frame->flags = flags;
    frame->length = length;
    memset(frame->data, 0, length);
}

static uint8_t nibbles(uint8_t low, uint8_t high) {
    return (uint8_t)((low & 0x0FU) | (high & 0x0FU) << 4);
}

uint16_t posfet_crc16(uint16_t crc, const uint8_t *bytes, size_t count) {
    // Four bits at a time: 32 bytes of flash, in place of 512 for whole bytes.
    static const uint16_t remainders[16] = {0x0000, 0x1021, 0x2042, 0x3063, 0x4084, 0x50A5, 0x60C6, 0x70E7,
                                            0x8108, 0x9129, 0xA14A, 0xB16B, 0xC18C, 0xD1AD, 0xE1CE, 0xF1EF};
    for (size_t i = 0; i < count; i++) {
        crc = (uint16_t)((crc << 4) ^ remainders[(crc >> 12) ^ (bytes[i] >> 4)]);
        crc = (uint16_t)((crc << 4) ^ remainders[(crc >> 12) ^ (bytes[i] & 0x0FU)]);
    }
    return crc;
}

static uint16_t blocks(uint16_t taxels, unsigned per_block) {
    return (uint16_t)((taxels + per_block - 1U) / per_block);
}

uint16_t posfet_fd_blocks(uint16_t taxels) {
    return blocks(taxels, POSFET_TAXELS_PER_FD_BLOCK);
}

uint16_t posfet_classic_blocks(uint16_t taxels) {
    return blocks(taxels, POSFET_TAXELS_PER_CLASSIC_BLOCK);
}

void posfet_encode_fd_block(posfet_frame *frame, uint32_t base_id, bool rate_switch, const posfet_scan *scan,
                            uint16_t block) {
    const uint8_t flags = (uint8_t)(rate_switch ? POSFET_FD | POSFET_RATE_SWITCH : POSFET_FD);
    begin(frame, base_id + POSFET_SCAN_BLOCK_FD, flags, FD_BYTES);
    uint8_t *data = frame->data;
    put_u32(data, scan->sequence);
    put_u32(data + 4, (uint32_t)(scan->time_us & UINT32_MAX));
    data[8] = (uint8_t)block;
    data[9] = nibbles(scan->flags, scan->boot);
    const unsigned first = (unsigned)block * POSFET_TAXELS_PER_FD_BLOCK;
    for (unsigned i = 0; i < POSFET_TAXELS_PER_FD_BLOCK && first + i < scan->taxels; i++)
        put_u16(data + COUNTS_AT + 2 * i, scan->counts[first + i]);
    uint16_t crc = posfet_crc16(POSFET_CRC_INITIAL, data, CHECKSUM_AT);
    crc = posfet_crc16(crc, data + COUNTS_AT, FD_BYTES - COUNTS_AT);
    put_u16(data + CHECKSUM_AT, crc);
}

void posfet_encode_header(posfet_frame *frame, uint32_t base_id, const posfet_scan *scan) {
    begin(frame, base_id + POSFET_SCAN_HEADER, 0, CLASSIC_BYTES);
    put_u32(frame->data, scan->sequence);
    put_u32(frame->data + 4, (uint32_t)(scan->time_us & 0x0FFFFFFFU) | (uint32_t)(scan->boot & 0x0FU) << 28);
}

void posfet_encode_classic_block(posfet_frame *frame, uint32_t base_id, const posfet_scan *scan, uint16_t block) {
    begin(frame, base_id + POSFET_SCAN_BLOCK + block, 0, CLASSIC_BYTES);
    const unsigned first = (unsigned)block * POSFET_TAXELS_PER_CLASSIC_BLOCK;
    uint64_t bits = scan->sequence & 0x0FU;
    for (unsigned i = 0; i < POSFET_TAXELS_PER_CLASSIC_BLOCK && first + i < scan->taxels; i++)
        bits |= (uint64_t)(scan->counts[first + i] >> 4) << (4U + 12U * i);
    put_u32(frame->data, (uint32_t)(bits & UINT32_MAX));
    put_u32(frame->data + 4, (uint32_t)(bits >> 32));
}

void posfet_encode_status(posfet_frame *frame, uint32_t base_id, const posfet_status *status) {
    begin(frame, base_id + POSFET_STATUS, 0, CLASSIC_BYTES);
    put_u16(frame->data, (uint16_t)status->temperatures[0]);
    put_u16(frame->data + 2, (uint16_t)status->temperatures[1]);
    put_u16(frame->data + 4, status->supply_mv);
    frame->data[6] = nibbles(status->flags, (uint8_t)((status->scanning ? 1 : 0) | (status->charge_reset ? 2 : 0)));
    frame->data[7] = nibbles(status->boot, status->heartbeat);
}

uint32_t posfet_identify_value(const posfet_identity *identity) {
    return identity->layout_id | (uint32_t)POSFET_PROTOCOL_VERSION << 16 | (uint32_t)(identity->fd ? 1 : 0) << 20 |
           (uint32_t)identity->firmware_major << 24;
}

void posfet_encode_identity(posfet_frame *frame, uint32_t base_id, const posfet_identity *identity) {
    begin(frame, base_id + POSFET_IDENTITY, 0, CLASSIC_BYTES);
    put_u32(frame->data, posfet_identify_value(identity));
    put_u32(frame->data + 4, identity->firmware_minor | identity->period_us << 8);
}

void posfet_encode_response(posfet_frame *frame, uint32_t base_id, const posfet_response *response) {
    begin(frame, base_id + POSFET_RESPONSE, 0, CLASSIC_BYTES);
    frame->data[0] = response->command;
    frame->data[1] = response->tag;
    frame->data[2] = response->result;
    frame->data[3] = nibbles(response->boot, 0);
    put_u32(frame->data + 4, response->value);
}
