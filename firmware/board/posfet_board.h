// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// A readout board as seen from the CAN bus: everything that docs/protocol.md asks of it, apart from hardware.
//
// Portable C99 without an operating system, heap or floating point. Hardware is behind posfet_port. The functions of one
// board are called from one context: from the main loop, or from one interrupt, or with that interrupt masked.
#ifndef POSFET_BOARD_H
#define POSFET_BOARD_H

#include "posfet_encode.h"

#ifndef POSFET_MAX_TAXELS
#define POSFET_MAX_TAXELS 25
#endif

// Frames that may wait: two scans, header included, and some others, which may be ahead of them or behind. Scans take no
// more than that, so that status and responses find room on a bus that scans fill.
#define POSFET_OTHER_FRAMES 8
#define POSFET_LARGEST_SCAN (POSFET_MAX_TAXELS / POSFET_TAXELS_PER_CLASSIC_BLOCK + 2)
#define POSFET_QUEUE_FRAMES (2 * POSFET_LARGEST_SCAN + 2 * POSFET_OTHER_FRAMES)

typedef struct {
    uint32_t base_id;            // identifier of Command
    uint16_t layout_id;          // not 0
    uint16_t taxels;             // 1 to POSFET_MAX_TAXELS
    bool fd;                     // scans as FD blocks
    bool rate_switch;            // of FD blocks
    uint8_t boot;                // number of this power-on; its low 4 bits are sent
    uint8_t firmware_major;      //
    uint8_t firmware_minor;      //
    uint32_t shortest_period_us; // also the period after power-on
    uint32_t period_step_us;     // periods that the scan timer keeps exactly are the multiples of this
    uint16_t supply_low_mv;      // below it SupplyLow is set; 0: never
    int16_t overtemperature;     // above it Overtemperature is set [1/256 degC]; 32767: never
    bool charge_reset;           // whether power-on resets the charge at the gates, as the switch of an amplifier does
    bool tests_while_scanning;   // whether the port's self test can run beside scans
} posfet_config;

// What hardware does. Each function gets `context`.
typedef struct {
    void *context;

    // Microseconds, wrapping at 2^32, never running backwards. The board must be polled more often than it wraps (71 min).
    uint32_t (*now_us)(void *context);

    // Hand a frame to the controller. False: no room now; the board offers the same frame again at the next poll.
    // The controller must keep the order, so several transmit buffers need a FIFO mode.
    bool (*send)(void *context, const posfet_frame *frame);

    // Sample all taxels, row by row, on a 16-bit scale. *started_us holds the present time: where the ADC is started by
    // a timer, set it to the time of the start. False: the ADC failed; counts are sent as they are, with AdcFault.
    bool (*sample)(void *context, uint16_t counts[], uint32_t *started_us);

    // The newest measurement, and when it was made (now_us). Those older than 1 s are sent as unknown.
    void (*temperatures)(void *context, int16_t temperatures[2], uint32_t *measured_us);
    uint16_t (*supply_mv)(void *context, uint32_t *measured_us);

    // Test what can be tested within 100 ms, and return the flags that were found (enum posfet_flag).
    uint8_t (*self_test)(void *context);
} posfet_port;

// When a measurement was made, by a clock that does not wrap.
typedef struct {
    bool known;
    uint32_t stamp;
    uint64_t time_us;
} posfet_age;

typedef struct {
    posfet_config config;
    posfet_port port;

    uint64_t time_us; // since power-on
    uint32_t clock;   // port's clock at time_us

    bool scanning;
    uint32_t period_us;
    uint64_t latest_tick_us;
    uint32_t next_sequence; // of the tick that follows the latest one
    bool header_due;        // of the next classic scan, whatever its sequence
    bool overrun;
    bool adc_fault;
    uint16_t counts[POSFET_MAX_TAXELS];

    uint64_t next_status_us;
    uint64_t next_identity_us;
    uint8_t heartbeat;
    uint8_t measured_flags; // of the newest supply and temperatures
    posfet_age temperature_age;
    posfet_age supply_age;

    uint16_t queue_first;
    uint16_t queue_length;
    posfet_frame queue[POSFET_QUEUE_FRAMES];
} posfet_board;

// Power on: time 0, tick 0 of the scan timer. False: the configuration is impossible, and the board must not be used.
bool posfet_board_init(posfet_board *board, const posfet_config *config, const posfet_port *port);

// Handle a frame from the bus; any frame may be passed. False: the queue has no room for the response; the frame had no
// effect and is to be passed again after a poll.
bool posfet_board_receive(posfet_board *board, const posfet_frame *frame);

// Do what is due. To be called when posfet_board_due_in_us() has passed, and when the controller can take frames again.
void posfet_board_poll(posfet_board *board);

// Time from the last poll to the next scan, status or identity [us].
uint32_t posfet_board_due_in_us(const posfet_board *board);

#endif
