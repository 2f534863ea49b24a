// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "clock.h"

#include "registers.h"

enum { TICKS_PER_US = CORE_CLOCK_HZ / 1000000U };

static uint32_t latest;   // timer's value at the latest reading
static uint32_t fraction; // ticks since the latest whole microsecond
static uint32_t microseconds;

void clock_init(void) {
    TIMER0->reload = UINT32_MAX;
    TIMER0->value = UINT32_MAX;
    TIMER0->ctrl = TIMER_ENABLE;
    latest = TIMER0->value;
}

uint32_t clock_us(void) {
    const uint32_t value = TIMER0->value;
    const uint32_t ticks = latest - value;
    latest = value;
    // Whole microseconds before the sum, which could exceed 32 bits.
    microseconds += ticks / TICKS_PER_US;
    fraction += ticks % TICKS_PER_US;
    if (fraction >= TICKS_PER_US) {
        fraction -= TICKS_PER_US;
        microseconds++;
    }
    return microseconds;
}

void clock_alarm(uint32_t us) {
    const uint32_t longest = SYSTICK_LONGEST / TICKS_PER_US;
    SYSTICK->ctrl = 0;
    SYSTICK->load = (us < 1 ? 1 : us < longest ? us : longest) * TICKS_PER_US;
    SYSTICK->value = 0;
    SYSTICK->ctrl = SYSTICK_ENABLE | SYSTICK_INTERRUPT | SYSTICK_CORE_CLOCK;
}
