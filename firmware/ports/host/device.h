// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// The board with simulated hardware: a clock that is set, signals, measurements and faults that are chosen.
#ifndef POSFET_HOST_DEVICE_H
#define POSFET_HOST_DEVICE_H

#include "posfet_board.h"
#include "press.h"
#include "table.h"

#include <stdio.h>

// Where the frames of the board go. False: no room now.
typedef bool (*posfet_host_send)(void *context, const posfet_frame *frame);

typedef struct {
    posfet_config config;
    posfet_press_config press;
    const char *table_path; // counts from a file in place of presses, or NULL
    const char *log_path;   // sampled scans are written to it, or NULL
} posfet_device_options;

typedef struct {
    posfet_board board;
    uint64_t clock_us; // time of the host; the board's own begins at power-on
    uint64_t power_on_us;
    posfet_press press;
    posfet_table table;
    bool has_table;
    FILE *log;

    int16_t temperatures[2]; // [1/256 degC]
    uint16_t supply_mv;
    bool adc_fault;

    posfet_host_send send;
    void *send_context;
} posfet_device;

// False: impossible options; the reason is on stderr.
bool posfet_device_init(posfet_device *device, const posfet_device_options *options, posfet_host_send send,
                        void *send_context);

// Let time pass. Each tick of the board falls on its exact time, as with an ADC that a timer starts, however late this
// process is; frames are then late, as behind any adapter.
void posfet_device_run_until(posfet_device *device, uint64_t clock_us);

// Let time pass in which the board's processor does nothing.
void posfet_device_stall_until(posfet_device *device, uint64_t clock_us);

// Switch the board off and on again. False: impossible configuration.
bool posfet_device_power_cycle(posfet_device *device, uint8_t boot);

#endif
