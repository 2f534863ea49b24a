// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "press.h"

enum {
    MIDDLE = 32768,    // count of a taxel without charge
    OFFSET = 255,      // largest deviation from it [count], assumed
    FRACTION = 16,     // of a count in `charge`
    RISE_BEGINS = 100, // steps of a press: a second of rest, 0.1 s of rise, 0.5 s of hold, 0.1 s of fall, rest
    RISE_ENDS = 110,
    FALL_BEGINS = 160,
    FALL_ENDS = 170,
};

static uint32_t mix(uint32_t value) { // finaliser of a multiplicative hash: each bit depends on all
    value = (value ^ value >> 16) * 0x7FEB352DU;
    value = (value ^ value >> 15) * 0x846CA68BU;
    return value ^ value >> 16;
}

static int32_t spread(uint32_t hash, int32_t limit) { // to -limit to limit
    return (int32_t)(hash % (uint32_t)(2 * limit + 1)) - limit;
}

static int32_t force_mn(const posfet_press_config *config, unsigned step) {
    if (step <= RISE_BEGINS || step >= FALL_ENDS) return 0;
    if (step < RISE_ENDS) return config->peak_mn * (int32_t)(step - RISE_BEGINS) / (RISE_ENDS - RISE_BEGINS);
    if (step <= FALL_BEGINS) return config->peak_mn;
    return config->peak_mn * (int32_t)(FALL_ENDS - step) / (FALL_ENDS - FALL_BEGINS);
}

void posfet_press_init(posfet_press *press, const posfet_press_config *config) {
    press->config = *config;
    int64_t charge = 0;
    int32_t before = 0;
    for (unsigned round = 0; round < 2; round++) { // the first round leads to the periodic course
        for (unsigned step = 0; step < POSFET_PRESS_STEPS; step++) {
            const int32_t force = force_mn(config, step);
            charge -= charge * POSFET_PRESS_STEP_US / (int64_t)config->leak_us;
            charge += (int64_t)(force - before) * config->counts_per_newton * FRACTION / 1000;
            before = force;
            press->charge[step] = (int32_t)charge;
        }
    }
}

// Share of the middle's force [1/256]: a paraboloid with a radius of two pitches.
static int32_t share(const posfet_press_config *config, int32_t row, int32_t col) {
    const int32_t dy = 2 * row - (config->rows - 1);
    const int32_t dx = 2 * col - (config->cols - 1);
    const int32_t distance = dx * dx + dy * dy; // [pitch2 / 4]
    return distance < 16 ? 256 - 16 * distance : 0;
}

void posfet_press_sample(const posfet_press *press, uint64_t time_us, uint16_t counts[]) {
    const posfet_press_config *config = &press->config;
    const uint32_t phase = (uint32_t)(time_us % ((uint32_t)POSFET_PRESS_STEPS * POSFET_PRESS_STEP_US));
    const uint32_t step = phase / POSFET_PRESS_STEP_US;
    const int32_t from = press->charge[step];
    const int32_t to = press->charge[(step + 1) % POSFET_PRESS_STEPS];
    const int32_t charge =
        from + (int32_t)((int64_t)(to - from) * (phase % POSFET_PRESS_STEP_US) / POSFET_PRESS_STEP_US);
    const uint32_t instant = mix((uint32_t)(time_us & UINT32_MAX) ^ config->seed);
    uint32_t taxel = 0;
    for (int32_t row = 0; row < config->rows; row++) {
        for (int32_t col = 0; col < config->cols; col++, taxel++) {
            const int32_t offset = spread(mix(taxel ^ mix(config->seed + 1U)), OFFSET);
            const int32_t noise = spread(mix(taxel + instant), config->noise);
            const int32_t signal = charge * share(config, row, col) / (256 * FRACTION);
            const int32_t count = MIDDLE + offset + noise + signal;
            counts[taxel] = (uint16_t)(count < 0 ? 0 : count > UINT16_MAX ? UINT16_MAX : count);
        }
    }
}
