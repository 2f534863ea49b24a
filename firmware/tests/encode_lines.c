// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Frames for a test from outside: each line of the input is a message of posfet.dbc and its raw signals in the order of
// the file, each line of the output the frame's bytes.
#include "posfet_encode.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIGNALS = 40, TAXELS = POSFET_FD_BLOCKS * POSFET_TAXELS_PER_FD_BLOCK };

static bool encode(posfet_frame *frame, const char *message, const int64_t signals[SIGNALS]) {
    static uint16_t counts[TAXELS];
    if (strcmp(message, "Response") == 0) {
        const posfet_response response = {(uint8_t)signals[0], (uint8_t)signals[1], (uint8_t)signals[2],
                                          (uint8_t)signals[3], (uint32_t)signals[4]};
        posfet_encode_response(frame, 0x100, &response);
    } else if (strcmp(message, "Status") == 0) {
        posfet_status status = {.temperatures = {(int16_t)signals[0], (int16_t)signals[1]},
                                .supply_mv = (uint16_t)signals[2],
                                .scanning = signals[7] != 0,
                                .charge_reset = signals[8] != 0,
                                .boot = (uint8_t)signals[9],
                                .heartbeat = (uint8_t)signals[10]};
        for (unsigned flag = 0; flag < 4; flag++)
            status.flags |= (uint8_t)(signals[3 + flag] << flag);
        posfet_encode_status(frame, 0x100, &status);
    } else if (strcmp(message, "Identity") == 0) {
        const posfet_identity identity = {(uint16_t)signals[0], signals[2] != 0, (uint8_t)signals[3],
                                          (uint8_t)signals[4], (uint32_t)signals[5]};
        posfet_encode_identity(frame, 0x100, &identity);
    } else if (strcmp(message, "ScanHeader") == 0) {
        const posfet_scan scan = {
            .sequence = (uint32_t)signals[0], .time_us = (uint64_t)signals[1], .boot = (uint8_t)signals[2]};
        posfet_encode_header(frame, 0x100, &scan);
    } else if (strcmp(message, "ScanBlockFd") == 0) {
        const uint16_t block = (uint16_t)signals[2];
        const unsigned first = (unsigned)block * POSFET_TAXELS_PER_FD_BLOCK;
        for (unsigned i = 0; i < POSFET_TAXELS_PER_FD_BLOCK; i++)
            counts[first + i] = (uint16_t)signals[6 + i];
        const posfet_scan scan = {.sequence = (uint32_t)signals[0],
                                  .time_us = (uint64_t)signals[1],
                                  .flags = (uint8_t)signals[3],
                                  .boot = (uint8_t)signals[4],
                                  .taxels = (uint16_t)(first + POSFET_TAXELS_PER_FD_BLOCK),
                                  .counts = counts};
        posfet_encode_fd_block(frame, 0x100, true, &scan, block);
    } else if (strncmp(message, "ScanBlock", 9) == 0) {
        const uint16_t block = (uint16_t)(message[9] - '0');
        const unsigned first = (unsigned)block * POSFET_TAXELS_PER_CLASSIC_BLOCK;
        for (unsigned i = 0; i < POSFET_TAXELS_PER_CLASSIC_BLOCK; i++)
            counts[first + i] = (uint16_t)(signals[1 + i] << 4 | 0x0F); // the low bits are not sent
        const posfet_scan scan = {.sequence = (uint32_t)signals[0] + 0xABCDE0,
                                  .taxels = (uint16_t)(first + POSFET_TAXELS_PER_CLASSIC_BLOCK),
                                  .counts = counts};
        posfet_encode_classic_block(frame, 0x100, &scan, block);
    } else {
        return false;
    }
    return true;
}

int main(void) {
    char line[1024];
    while (fgets(line, sizeof line, stdin)) {
        int64_t signals[SIGNALS] = {0};
        char message[16] = "";
        int end = 0;
        if (sscanf(line, "%15s%n", message, &end) != 1) return 1;
        char *rest = line + end;
        for (unsigned i = 0; i < SIGNALS && *rest != '\n' && *rest != '\0'; i++)
            signals[i] = strtoll(rest, &rest, 10);
        posfet_frame frame;
        if (!encode(&frame, message, signals)) return 1;
        for (unsigned i = 0; i < frame.length; i++)
            printf("%02x", (unsigned)frame.data[i]);
        putchar('\n');
    }
    return 0;
}
