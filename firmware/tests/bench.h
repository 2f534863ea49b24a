// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// A board whose hardware is variables, and the frames that it has sent.
#ifndef POSFET_BENCH_H
#define POSFET_BENCH_H

#include "check.h"
#include "posfet_board.h"

#include <string.h>

enum { BENCH_FRAMES = 1 << 15 };

typedef struct {
    uint64_t clock; // the port's clock is its low 32 bits
    posfet_frame sent[BENCH_FRAMES];
    uint64_t sent_at[BENCH_FRAMES];
    unsigned count;
    unsigned room; // frames that the controller still takes
    uint16_t counts[POSFET_MAX_TAXELS];
    uint32_t sampled_before_us;
    uint32_t sampled_after_us;
    bool adc_fails;
    unsigned samples;
    int16_t temperatures[2];
    uint16_t supply_mv;
    uint32_t measured_us;
    bool measures_now; // otherwise at measured_us
    uint8_t found;
    uint32_t test_us; // duration of the self test
} bench;

static bench hw;
static posfet_board board;

static uint32_t bench_now(void *context) {
    (void)context;
    return (uint32_t)(hw.clock & UINT32_MAX);
}

static bool bench_send(void *context, const posfet_frame *frame) {
    (void)context;
    if (hw.room == 0) return false;
    hw.room--;
    CHECK(hw.count < BENCH_FRAMES);
    hw.sent_at[hw.count] = hw.clock;
    hw.sent[hw.count++] = *frame;
    return true;
}

static bool bench_sample(void *context, uint16_t counts[], uint32_t *started_us) {
    (void)context;
    CHECK_EQUAL(*started_us, bench_now(NULL));
    *started_us += hw.sampled_after_us - hw.sampled_before_us;
    hw.samples++;
    memcpy(counts, hw.counts, board.config.taxels * sizeof *counts);
    return !hw.adc_fails;
}

static void bench_temperatures(void *context, int16_t temperatures[2], uint32_t *measured_us) {
    (void)context;
    temperatures[0] = hw.temperatures[0];
    temperatures[1] = hw.temperatures[1];
    if (!hw.measures_now) *measured_us = hw.measured_us;
}

static uint16_t bench_supply(void *context, uint32_t *measured_us) {
    (void)context;
    if (!hw.measures_now) *measured_us = hw.measured_us;
    return hw.supply_mv;
}

static uint8_t bench_self_test(void *context) {
    (void)context;
    hw.clock += hw.test_us;
    return hw.found;
}

static const posfet_port bench_port = {NULL,         bench_now,      bench_send, bench_sample, bench_temperatures,
                                       bench_supply, bench_self_test};

static posfet_config bench_config(void) {
    return (posfet_config){
        .base_id = 0x100,
        .layout_id = 1,
        .taxels = 25,
        .fd = true,
        .rate_switch = true,
        .boot = 7,
        .firmware_major = 3,
        .firmware_minor = 4,
        .shortest_period_us = 1000,
        .period_step_us = 1,
        .supply_low_mv = 3000,
        .overtemperature = 85 * 256,
    };
}

// Power on with the clock at a value, and poll once.
static void power_on(const posfet_config *config, uint64_t clock) {
    memset(&hw, 0, sizeof hw);
    hw.clock = clock;
    hw.room = UINT32_MAX;
    hw.temperatures[0] = hw.temperatures[1] = 25 * 256;
    hw.supply_mv = 3300;
    hw.measures_now = true;
    for (unsigned i = 0; i < POSFET_MAX_TAXELS; i++)
        hw.counts[i] = (uint16_t)(1000 + 37 * i);
    CHECK(posfet_board_init(&board, config, &bench_port));
    posfet_board_poll(&board);
}

// Let time pass, with polls exactly when something is due.
static void run_for(uint64_t us) {
    const uint64_t end = hw.clock + us;
    for (;;) {
        posfet_board_poll(&board);
        if (hw.clock >= end) return;
        const uint64_t due = posfet_board_due_in_us(&board);
        hw.clock += due < end - hw.clock ? due : end - hw.clock;
    }
}

static posfet_frame command_frame(uint8_t code, uint8_t tag, uint32_t argument) {
    return (posfet_frame){
        .id = board.config.base_id,
        .length = 8,
        .data = {code, tag, 0, 0, (uint8_t)(argument & 255U), (uint8_t)(argument >> 8 & 255U),
                 (uint8_t)(argument >> 16 & 255U), (uint8_t)(argument >> 24)},
    };
}

typedef struct {
    unsigned result;
    uint32_t value;
    unsigned at; // number of the frame
} answer;

// Send a command and return its only response, which must arrive at once.
static answer command(uint8_t code, uint32_t argument) {
    static uint8_t tag;
    const unsigned before = hw.count;
    const posfet_frame frame = command_frame(code, ++tag, argument);
    CHECK(posfet_board_receive(&board, &frame));
    answer found = {0, 0, 0};
    unsigned responses = 0;
    for (unsigned i = before; i < hw.count; i++) {
        const posfet_frame *sent = &hw.sent[i];
        if (sent->id != board.config.base_id + POSFET_RESPONSE) continue;
        responses++;
        CHECK_EQUAL(sent->data[0], code);
        CHECK_EQUAL(sent->data[1], tag);
        CHECK_EQUAL(sent->data[3], board.config.boot & 15U);
        found = (answer){sent->data[2], posfet_get_u32(sent->data + 4), i};
    }
    CHECK_EQUAL(responses, 1);
    return found;
}

static uint32_t offset_of(const posfet_frame *frame) {
    return frame->id - board.config.base_id;
}

// Number of the n-th frame (from 0) with an offset after the first `from` ones; -1 if there is none.
static int find_frame(uint32_t offset, unsigned from, unsigned n) {
    for (unsigned i = from; i < hw.count; i++)
        if (offset_of(&hw.sent[i]) == offset && n-- == 0) return (int)i;
    return -1;
}

static unsigned frames_with(uint32_t offset, unsigned from) {
    unsigned count = 0;
    while (find_frame(offset, from, count) >= 0)
        count++;
    return count;
}

#endif
