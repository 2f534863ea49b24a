// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "virtual_time.h"

#include "slcan.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    posfet_device device;
    bool blocked; // the bus takes no frames
    bool stamps;  // write the time before frames
    bool stamped;
    uint64_t stamp_us;
} session;

static bool write_frame(void *context, const posfet_frame *frame) {
    session *run = context;
    if (run->blocked) return false;
    if (run->stamps && (!run->stamped || run->stamp_us != run->device.clock_us)) {
        run->stamped = true;
        run->stamp_us = run->device.clock_us;
        printf("@%" PRIu64 "\n", run->stamp_us);
    }
    char line[POSFET_SLCAN_LINE];
    const size_t length = posfet_slcan_format(frame, line);
    line[length - 1] = '\n';
    fwrite(line, 1, length, stdout);
    return true;
}

static bool read_numbers(const char *text, int64_t lowest, int64_t highest, unsigned count, int64_t values[]) {
    for (unsigned i = 0; i < count; i++) {
        char *end = NULL;
        values[i] = strtoll(text, &end, 10);
        if (end == text || values[i] < lowest || values[i] > highest) return false;
        text = end;
    }
    return *text == '\0';
}

static bool run_frame(session *run, const char *text) {
    posfet_frame frame;
    if (*text == ' ') text++;
    if (!posfet_slcan_parse(text, strlen(text), &frame)) return false;
    // A controller on a blocked bus receives nothing, but the board's queue may be full for a moment after it.
    return posfet_board_receive(&run->device.board, &frame);
}

static bool run_line(session *run, const char *line) {
    posfet_device *device = &run->device;
    const char *rest = line + 1;
    int64_t values[2];
    switch (line[0]) {
    case 'T':
    case 'J':
        if (!read_numbers(rest, (int64_t)device->clock_us, INT64_MAX, 1, values)) return false;
        (line[0] == 'T' ? posfet_device_run_until : posfet_device_stall_until)(device, (uint64_t)values[0]);
        return true;
    case 'F': return run_frame(run, rest);
    case 'B':
        if (!read_numbers(rest, 0, 1, 1, values)) return false;
        run->blocked = values[0] != 0;
        posfet_board_poll(&device->board);
        return true;
    case 'V':
        if (!read_numbers(rest, 0, UINT16_MAX, 1, values)) return false;
        device->supply_mv = (uint16_t)values[0];
        return true;
    case 'K':
        if (!read_numbers(rest, INT16_MIN, INT16_MAX, 2, values)) return false;
        device->temperatures[0] = (int16_t)values[0];
        device->temperatures[1] = (int16_t)values[1];
        return true;
    case 'A':
        if (!read_numbers(rest, 0, 1, 1, values)) return false;
        device->adc_fault = values[0] != 0;
        return true;
    case 'R':
        if (!read_numbers(rest, 0, 15, 1, values)) return false;
        if (!posfet_device_power_cycle(device, (uint8_t)values[0])) return false;
        posfet_board_poll(&device->board);
        return true;
    default: return false;
    }
}

int posfet_run_virtual_time(const posfet_device_options *options, bool stamps) {
    static session run; // too large for a stack with the largest layout
    static char output[1 << 16];
    setvbuf(stdout, output, _IOFBF, sizeof output);
    run.stamps = stamps;
    if (!posfet_device_init(&run.device, options, write_frame, &run)) return EXIT_FAILURE;
    char line[256];
    while (fgets(line, sizeof line, stdin)) {
        const size_t length = strcspn(line, "\r\n");
        const bool whole = line[length] != '\0';
        line[length] = '\0';
        fputs(whole && run_line(&run, line) ? ".\n" : "?\n", stdout);
        fflush(stdout);
    }
    return EXIT_SUCCESS;
}
