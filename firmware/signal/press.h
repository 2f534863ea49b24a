// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Counts of an array that is pressed again and again: a force that rises, holds and falls, as charge that leaks.
// Integers only, so that it also runs on a microcontroller.
#ifndef POSFET_PRESS_H
#define POSFET_PRESS_H

#include <stdint.h>

enum { POSFET_PRESS_STEPS = 256, POSFET_PRESS_STEP_US = 10000 };

typedef struct {
    uint16_t rows;
    uint16_t cols;
    int32_t counts_per_newton; // before leakage
    int32_t peak_mn;           // force on the taxel in the middle [mN]; neighbours have less
    uint32_t leak_us;          // time constant of the leakage
    int32_t noise;             // largest deviation [count]
    uint32_t seed;             // of offsets and noise
} posfet_press_config;

typedef struct {
    posfet_press_config config;
    int32_t charge[POSFET_PRESS_STEPS]; // of the taxel in the middle, over one press [1/16 count]
} posfet_press;

void posfet_press_init(posfet_press *press, const posfet_press_config *config);

// Counts at a time since power-on, row by row.
void posfet_press_sample(const posfet_press *press, uint64_t time_us, uint16_t counts[]);

#endif
