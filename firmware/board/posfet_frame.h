// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// One CAN frame, and the numbers that a frame of the protocol is made of.
#ifndef POSFET_FRAME_H
#define POSFET_FRAME_H

#include <stdint.h>

enum { POSFET_DATA_BYTES = 64 };

enum posfet_frame_flag {
    POSFET_EXTENDED = 1,    // 29-bit identifier
    POSFET_REMOTE = 2,      //
    POSFET_FD = 4,          //
    POSFET_RATE_SWITCH = 8, // only with POSFET_FD
};

typedef struct {
    uint32_t id;
    uint8_t flags;  // of enum posfet_frame_flag; 0: classic data frame with an 11-bit identifier
    uint8_t length; // [byte]; with FD a length that exists: 0 to 8, 12, 16, 20, 24, 32, 48, 64
    uint8_t data[POSFET_DATA_BYTES];
} posfet_frame;

#endif
