// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#define _GNU_SOURCE // ppoll
#include "event_loop.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum {
    RETRY_US = 1000,   // frames that found no room
    LISTEN_US = 10000, // for somebody who opens the pseudo-terminal
};

static volatile sig_atomic_t stop_asked;
static volatile sig_atomic_t power_cycle_asked;

static void on_signal(int number) {
    if (number == SIGHUP)
        power_cycle_asked = 1;
    else
        stop_asked = 1;
}

static uint64_t monotonic_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000U + (uint64_t)now.tv_nsec / 1000U;
}

// Signals are blocked but while the process waits, so that none is missed.
static void prepare_signals(sigset_t *while_waiting) {
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    sigset_t blocked;
    sigemptyset(&blocked);
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        sigaction(numbers[i], &action, NULL);
        sigaddset(&blocked, numbers[i]);
    }
    sigprocmask(SIG_BLOCK, &blocked, while_waiting);
}

int posfet_run_event_loop(posfet_device *device, const posfet_link *link) {
    sigset_t while_waiting;
    prepare_signals(&while_waiting);
    const uint64_t begin = monotonic_us() - device->clock_us;
    while (!stop_asked) {
        if (power_cycle_asked) {
            power_cycle_asked = 0;
            posfet_device_power_cycle(device, (uint8_t)((device->board.config.boot + 1U) & 15U));
        }
        posfet_device_run_until(device, monotonic_us() - begin);
        if (!link->flush(link->context)) return EXIT_FAILURE;

        uint32_t due = posfet_board_due_in_us(&device->board);
        if (device->board.queue_length > 0 && due > RETRY_US) due = RETRY_US;
        struct pollfd waits = {.fd = link->fd, .events = link->events(link->context)};
        const nfds_t count = waits.events == 0 ? 0 : 1; // a pseudo-terminal that nobody has opened is always ready
        if (count == 0 && due > LISTEN_US) due = LISTEN_US;
        const struct timespec timeout = {due / 1000000U, (long)(due % 1000000U) * 1000L};
        if (ppoll(&waits, count, &timeout, &while_waiting) < 0 && errno != EINTR) {
            perror("ppoll");
            return EXIT_FAILURE;
        }
        posfet_device_run_until(device, monotonic_us() - begin);
        if (!link->receive(link->context)) return EXIT_FAILURE;
    }
    return EXIT_SUCCESS;
}
