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
