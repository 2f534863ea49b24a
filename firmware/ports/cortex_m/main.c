// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Board and serial CAN adapter in one: 5 x 5 taxels that are pressed by a table, the bus is the UART.
#include "clock.h"
#include "posfet_board.h"
#include "press.h"
#include "slcan.h"
#include "uart.h"

#include <string.h>

#ifndef POSFET_PORT_FD
#define POSFET_PORT_FD 1
#endif

enum { FOR_REPLIES = 64, BOOT_MAGIC = 0x0B007ED };

// The memory that outlives a reset takes the place of a non-volatile one.
static struct {
    uint32_t magic;
    uint32_t number;
} boot __attribute__((section(".noinit")));

static posfet_board board;
static posfet_slcan adapter;
static posfet_press press;

static uint32_t now_us(void *context) {
    (void)context;
    return clock_us();
}

static bool send_frame(void *context, const posfet_frame *frame) {
    (void)context;
    if (!adapter.open) return true; // on the bus, where nobody listens
    char line[POSFET_SLCAN_LINE];
    const size_t length = posfet_slcan_format(frame, line);
    return uart_write(line, length, FOR_REPLIES);
}

static bool sample(void *context, uint16_t counts[], uint32_t *started_us) {
    (void)context;
    (void)started_us;
    posfet_press_sample(&press, board.time_us, counts);
    return true;
}

static void temperatures(void *context, int16_t values[2], uint32_t *measured_us) {
    (void)context;
    (void)measured_us;
    values[0] = values[1] = 25 * 256; // assumed: the machine has no sensor
}

static uint16_t supply_mv(void *context, uint32_t *measured_us) {
    (void)context;
    (void)measured_us;
    return 3300; // assumed
}

static uint8_t self_test(void *context) {
    (void)context;
    return 0;
}

static uint8_t next_boot(void) {
    if (boot.magic == BOOT_MAGIC) {
        boot.number++;
    } else {
        // After a loss of power the memory holds what it likes, which is the random number that the protocol asks for.
        boot.number ^= boot.magic ^ boot.magic >> 16;
        boot.magic = BOOT_MAGIC;
    }
    return (uint8_t)(boot.number & 15U);
}

// Takes what has arrived. False: a command waits for room in the board's queue.
static bool run_input(bool *waits) {
    if (*waits && !posfet_board_receive(&board, &adapter.frame)) return false;
    *waits = false;
    char byte;
    while (uart_read(&byte)) {
        const enum posfet_slcan_event event = posfet_slcan_take(&adapter, byte);
        if (event == POSFET_SLCAN_NOTHING) continue;
        uart_write(adapter.reply, strlen(adapter.reply), 0);
        if (event == POSFET_SLCAN_SEND && !posfet_board_receive(&board, &adapter.frame)) {
            *waits = true;
            return false;
        }
    }
    return true;
}

int main(void) {
    static const posfet_config config = {
        .base_id = 0x100,
        .layout_id = 1,
        .taxels = 25,
        .fd = POSFET_PORT_FD,
        .rate_switch = POSFET_PORT_FD,
        .firmware_major = 1,
        .shortest_period_us = 1000,
        .period_step_us = 1,
        .supply_low_mv = 3000,
        .overtemperature = 85 * 256,
    };
    static const posfet_press_config signal = {
        .rows = 5, .cols = 5, .counts_per_newton = 5815, .peak_mn = 500, .leak_us = 270000, .noise = 3, .seed = 1};
    static const posfet_port port = {NULL, now_us, send_frame, sample, temperatures, supply_mv, self_test};

    clock_init();
    uart_init();
    posfet_slcan_init(&adapter);
    posfet_press_init(&press, &signal);
    posfet_config powered_on = config;
    powered_on.boot = next_boot();
    if (!posfet_board_init(&board, &powered_on, &port)) return 1;

    bool waits = false;
    for (;;) {
        const bool idle = run_input(&waits);
        posfet_board_poll(&board);
        // An interrupt that comes between the question and WFI is pending, and WFI returns at once.
        __asm volatile("cpsid i" ::: "memory");
        if (!uart_has_input() || !idle) {
            const uint32_t due = posfet_board_due_in_us(&board);
            if (due > 0) {
                clock_alarm(board.queue_length > 0 && due > 1000 ? 1000 : due);
                __asm volatile("wfi" ::: "memory");
            }
        }
        __asm volatile("cpsie i" ::: "memory");
    }
}
