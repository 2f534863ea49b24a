// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "device.h"

#include <inttypes.h>
#include <string.h>

enum { STEP_OF_STALL_US = 1 << 30 }; // the board's clock wraps at 2^32

static uint32_t now_us(void *context) {
    return (uint32_t)(((const posfet_device *)context)->clock_us & UINT32_MAX);
}

static bool send_frame(void *context, const posfet_frame *frame) {
    const posfet_device *device = context;
    return device->send(device->send_context, frame);
}

static bool sample(void *context, uint16_t counts[], uint32_t *started_us) {
    posfet_device *device = context;
    (void)started_us;
    const uint64_t time = device->clock_us - device->power_on_us;
    if (device->has_table)
        posfet_table_sample(&device->table, time, counts);
    else
        posfet_press_sample(&device->press, time, counts);
    if (device->log) {
        fprintf(device->log, "%u %" PRIu32 " %" PRIu64, device->board.config.boot & 15U,
                device->board.next_sequence - 1U, time);
        for (unsigned i = 0; i < device->board.config.taxels; i++)
            fprintf(device->log, " %u", counts[i]);
        fputc('\n', device->log);
    }
    return !device->adc_fault;
}

static void temperatures(void *context, int16_t values[2], uint32_t *measured_us) {
    const posfet_device *device = context;
    (void)measured_us;
    values[0] = device->temperatures[0];
    values[1] = device->temperatures[1];
}

static uint16_t supply_mv(void *context, uint32_t *measured_us) {
    (void)measured_us;
    return ((const posfet_device *)context)->supply_mv;
}

static uint8_t self_test(void *context) {
    return ((const posfet_device *)context)->adc_fault ? POSFET_ADC_FAULT : 0;
}

static bool power_on(posfet_device *device, const posfet_config *config) {
    const posfet_port port = {device, now_us, send_frame, sample, temperatures, supply_mv, self_test};
    device->power_on_us = device->clock_us;
    return posfet_board_init(&device->board, config, &port);
}

bool posfet_device_init(posfet_device *device, const posfet_device_options *options, posfet_host_send send,
                        void *send_context) {
    memset(device, 0, sizeof *device);
    device->temperatures[0] = device->temperatures[1] = 25 * 256;
    device->supply_mv = 3300;
    device->send = send;
    device->send_context = send_context;
    if (options->table_path) {
        device->has_table = true;
        if (!posfet_table_read(&device->table, options->table_path, options->config.taxels)) return false;
    }
    posfet_press_init(&device->press, &options->press);
    if (options->log_path) {
        device->log = fopen(options->log_path, "w");
        if (!device->log) {
            perror(options->log_path);
            return false;
        }
        setvbuf(device->log, NULL, _IOLBF, 0);
    }
    if (power_on(device, &options->config)) return true;
    fputs("posfet_board: no board has this combination of layout, format, base identifier and period\n", stderr);
    return false;
}

bool posfet_device_power_cycle(posfet_device *device, uint8_t boot) {
    posfet_config config = device->board.config;
    config.boot = boot;
    return power_on(device, &config);
}

void posfet_device_run_until(posfet_device *device, uint64_t clock_us) {
    // The last poll of each step is of the present clock, so that the time until the next event counts from it.
    for (;;) {
        posfet_board_poll(&device->board);
        if (device->clock_us >= clock_us) return;
        const uint64_t left = clock_us - device->clock_us;
        const uint64_t due = posfet_board_due_in_us(&device->board);
        device->clock_us += due < left ? due : left;
    }
}

void posfet_device_stall_until(posfet_device *device, uint64_t clock_us) {
    while (device->clock_us + STEP_OF_STALL_US < clock_us) {
        device->clock_us += STEP_OF_STALL_US;
        posfet_board_poll(&device->board);
    }
    if (device->clock_us < clock_us) device->clock_us = clock_us;
    posfet_board_poll(&device->board);
}
