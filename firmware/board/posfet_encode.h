// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Frames of docs/protocol.md from their values. Pure functions: no state, no clock. Reserved bits are 0.
#ifndef POSFET_ENCODE_H
#define POSFET_ENCODE_H

#include "posfet_frame.h"

#include <stdbool.h>
#include <stddef.h>

enum {
    POSFET_PROTOCOL_VERSION = 2,
    POSFET_TAXELS_PER_FD_BLOCK = 26,
    POSFET_TAXELS_PER_CLASSIC_BLOCK = 5,
    POSFET_FD_BLOCKS = 256,    // limit of BlockIndex
    POSFET_HIGHEST_ID = 0x7FF, // of 11 bits
    POSFET_HEADER_SCANS = 16,  // a header precedes each sequence that is a multiple of this
    POSFET_TEMPERATURE_UNKNOWN = -32768,
    POSFET_SUPPLY_UNKNOWN = 65535,
};

// Identifier of a frame less the base identifier of the board.
enum posfet_offset {
    POSFET_COMMAND = 0,
    POSFET_RESPONSE = 1,
    POSFET_STATUS = 2,
    POSFET_SCAN_BLOCK_FD = 3,
    POSFET_SCAN_HEADER = 4,
    POSFET_IDENTITY = 5,
    POSFET_SCAN_BLOCK = 8, // block k: 8 + k
};

enum posfet_command {
    POSFET_START = 1,
    POSFET_STOP = 2,
    POSFET_SET_RATE = 3,
    POSFET_IDENTIFY = 4,
    POSFET_SELF_TEST = 5,
};

enum posfet_result {
    POSFET_OK = 0,
    POSFET_UNKNOWN_COMMAND = 1,
    POSFET_BAD_ARGUMENT = 2,
    POSFET_BUSY = 3,
    POSFET_FAILED = 4,
};

enum posfet_flag {
    POSFET_SUPPLY_LOW = 1,
    POSFET_ADC_FAULT = 2,
    POSFET_OVERTEMPERATURE = 4,
    POSFET_SCAN_OVERRUN = 8,
};

typedef struct {
    uint32_t sequence;
    uint64_t time_us; // since power-on, at the start of the sampling
    uint8_t flags;    // of enum posfet_flag
    uint8_t boot;
    uint16_t taxels;
    const uint16_t *counts;
} posfet_scan;

typedef struct {
    int16_t temperatures[2]; // [1/256 degC], or POSFET_TEMPERATURE_UNKNOWN
    uint16_t supply_mv;      // or POSFET_SUPPLY_UNKNOWN
    uint8_t flags;
    bool scanning;
    bool charge_reset; // of posfet_config
    uint8_t boot;
    uint8_t heartbeat;
} posfet_status;

typedef struct {
    uint16_t layout_id;
    bool fd;
    uint8_t firmware_major;
    uint8_t firmware_minor;
    uint32_t period_us;
} posfet_identity;

typedef struct {
    uint8_t command;
    uint8_t tag;
    uint8_t result; // of enum posfet_result
    uint8_t boot;
    uint32_t value;
} posfet_response;

// CRC-16/CCITT-FALSE of more bytes; a new checksum begins with POSFET_CRC_INITIAL.
enum { POSFET_CRC_INITIAL = 0xFFFF };
uint16_t posfet_crc16(uint16_t crc, const uint8_t *bytes, size_t count);

uint16_t posfet_fd_blocks(uint16_t taxels);
uint16_t posfet_classic_blocks(uint16_t taxels);

void posfet_encode_fd_block(posfet_frame *frame, uint32_t base_id, bool rate_switch, const posfet_scan *scan,
                            uint16_t block);
void posfet_encode_header(posfet_frame *frame, uint32_t base_id, const posfet_scan *scan);
void posfet_encode_classic_block(posfet_frame *frame, uint32_t base_id, const posfet_scan *scan, uint16_t block);
void posfet_encode_status(posfet_frame *frame, uint32_t base_id, const posfet_status *status);
void posfet_encode_identity(posfet_frame *frame, uint32_t base_id, const posfet_identity *identity);
void posfet_encode_response(posfet_frame *frame, uint32_t base_id, const posfet_response *response);

// What IDENTIFY answers: the first four bytes of Identity as a number.
uint32_t posfet_identify_value(const posfet_identity *identity);

uint32_t posfet_get_u32(const uint8_t bytes[4]);

#endif
