// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_board.h"

#include <string.h>

#define STATUS_PERIOD_US   UINT32_C(100000)
#define IDENTITY_PERIOD_US UINT32_C(1000000)
#define LONGEST_PERIOD_US  UINT32_C(10000000)
#define LONGEST_AGE_US     UINT32_C(1000000)

enum { COMMAND_BYTES = 8, FRAMES_PER_COMMAND = 2 };

static void advance(posfet_board *board) {
    const uint32_t clock = board->port.now_us(board->port.context);
    board->time_us += (uint32_t)(clock - board->clock);
    board->clock = clock;
}

// Time since power-on of a stamp of the port's clock, which may be a little earlier or later than the newest reading.
static uint64_t time_of(const posfet_board *board, uint32_t stamp) {
    const uint32_t after = stamp - board->clock;
    if (after <= UINT32_MAX / 2) return board->time_us + after;
    const uint32_t before = board->clock - stamp;
    return before < board->time_us ? board->time_us - before : 0;
}

static uint64_t next_tick_us(const posfet_board *board) {
    return board->latest_tick_us + board->period_us;
}

// Queue

static unsigned queue_room(const posfet_board *board) {
    return POSFET_QUEUE_FRAMES - (unsigned)board->queue_length;
}

// The caller has made sure that there is room.
static posfet_frame *queue_append(posfet_board *board) {
    const unsigned last = ((unsigned)board->queue_first + board->queue_length) % POSFET_QUEUE_FRAMES;
    board->queue_length++;
    return &board->queue[last];
}

static void queue_flush(posfet_board *board) {
    while (board->queue_length > 0 && board->port.send(board->port.context, &board->queue[board->queue_first])) {
        board->queue_first = (uint16_t)((board->queue_first + 1U) % POSFET_QUEUE_FRAMES);
        board->queue_length--;
    }
}

// Scans

static bool is_header_due(const posfet_board *board, uint32_t sequence) {
    return board->header_due || sequence % POSFET_HEADER_SCANS == 0;
}

static unsigned frames_of_scan(const posfet_board *board, uint32_t sequence) {
    if (board->config.fd) return posfet_fd_blocks(board->config.taxels);
    return posfet_classic_blocks(board->config.taxels) + (is_header_due(board, sequence) ? 1U : 0U);
}

static bool has_room_for_scan(const posfet_board *board, uint32_t sequence) {
    const unsigned largest =
        board->config.fd ? posfet_fd_blocks(board->config.taxels) : posfet_classic_blocks(board->config.taxels) + 1U;
    return board->queue_length + frames_of_scan(board, sequence) <= 2U * largest + POSFET_OTHER_FRAMES;
}

static uint8_t present_flags(const posfet_board *board) {
    return (uint8_t)(board->measured_flags | (board->adc_fault ? POSFET_ADC_FAULT : 0) |
                     (board->overrun ? POSFET_SCAN_OVERRUN : 0));
}

static void queue_scan(posfet_board *board, const posfet_scan *scan) {
    const uint32_t base_id = board->config.base_id;
    if (board->config.fd) {
        for (uint16_t block = 0; block < posfet_fd_blocks(scan->taxels); block++)
            posfet_encode_fd_block(queue_append(board), base_id, board->config.rate_switch, scan, block);
        return;
    }
    if (is_header_due(board, scan->sequence)) posfet_encode_header(queue_append(board), base_id, scan);
    board->header_due = false;
    for (uint16_t block = 0; block < posfet_classic_blocks(scan->taxels); block++)
        posfet_encode_classic_block(queue_append(board), base_id, scan, block);
}

// A scan is missing: without a header before the next one, its blocks do not tell how many are.
static void note_missing(posfet_board *board) { board->overrun = board->header_due = true; }

static void scan(posfet_board *board, uint32_t sequence) {
    if (!has_room_for_scan(board, sequence)) {
        note_missing(board);
        return;
    }
    uint32_t started = board->clock;
    board->adc_fault = !board->port.sample(board->port.context, board->counts, &started);
    const posfet_scan made = {
        .sequence = sequence,
        .time_us = time_of(board, started),
        .flags = present_flags(board),
        .boot = board->config.boot,
        .taxels = board->config.taxels,
        .counts = board->counts,
    };
    // A scan before which nothing waits is sent without delay. It is the last one that carries the flag.
    if (board->queue_length == 0) board->overrun = false;
    queue_scan(board, &made);
}

static void run_scan_timer(posfet_board *board) {
    if (board->time_us < next_tick_us(board)) return;
    // Only the latest of several ticks can still be sampled.
    const uint64_t missed = (board->time_us - next_tick_us(board)) / board->period_us;
    board->latest_tick_us += (missed + 1) * board->period_us;
    board->next_sequence += (uint32_t)(missed & UINT32_MAX);
    const uint32_t sequence = board->next_sequence++;
    if (!board->scanning) return;
    if (missed > 0) note_missing(board);
    scan(board, sequence);
}

// Status and identity

static bool is_fresh(const posfet_board *board, posfet_age *age, uint32_t stamp) {
    // The same stamp again is an old measurement, however often the clock has wrapped since.
    if (!age->known || age->stamp != stamp) {
        age->known = true;
        age->stamp = stamp;
        age->time_us = time_of(board, stamp);
    }
    return board->time_us <= age->time_us + LONGEST_AGE_US;
}

static void measure(posfet_board *board, int16_t temperatures[2], uint16_t *supply_mv) {
    void *context = board->port.context;
    uint32_t stamp = board->clock;
    temperatures[0] = temperatures[1] = POSFET_TEMPERATURE_UNKNOWN;
    board->port.temperatures(context, temperatures, &stamp);
    if (!is_fresh(board, &board->temperature_age, stamp))
        temperatures[0] = temperatures[1] = POSFET_TEMPERATURE_UNKNOWN;
    stamp = board->clock;
    *supply_mv = board->port.supply_mv(context, &stamp);
    if (!is_fresh(board, &board->supply_age, stamp)) *supply_mv = POSFET_SUPPLY_UNKNOWN;

    // The number for unknown is the lowest temperature and the highest supply, and so neither too hot nor too low.
    const bool hot = temperatures[0] > board->config.overtemperature || temperatures[1] > board->config.overtemperature;
    const bool low = *supply_mv < board->config.supply_low_mv;
    board->measured_flags = (uint8_t)((hot ? POSFET_OVERTEMPERATURE : 0) | (low ? POSFET_SUPPLY_LOW : 0));
}

static void queue_status(posfet_board *board) {
    posfet_status status = {
        .scanning = board->scanning,
        .charge_reset = board->config.charge_reset,
        .boot = board->config.boot,
        .heartbeat = board->heartbeat++,
    };
    measure(board, status.temperatures, &status.supply_mv);
    status.flags = present_flags(board);
    posfet_encode_status(queue_append(board), board->config.base_id, &status);
}

static posfet_identity identity_of(const posfet_board *board) {
    return (posfet_identity){
        .layout_id = board->config.layout_id,
        .fd = board->config.fd,
        .firmware_major = board->config.firmware_major,
        .firmware_minor = board->config.firmware_minor,
        .period_us = board->period_us,
    };
}

static void queue_identity(posfet_board *board) {
    const posfet_identity identity = identity_of(board);
    posfet_encode_identity(queue_append(board), board->config.base_id, &identity);
}

// Moves `due_us` on in whole periods to the future. Returns whether it was due.
static bool run_report_timer(posfet_board *board, uint64_t *due_us, uint32_t period_us) {
    if (board->time_us < *due_us || queue_room(board) == 0) return false;
    *due_us += ((board->time_us - *due_us) / period_us + 1) * period_us;
    return true;
}

// Commands

static bool is_command(const posfet_board *board, const posfet_frame *frame) {
    return frame->flags == 0 && frame->id == board->config.base_id + POSFET_COMMAND && frame->length == COMMAND_BYTES;
}

static bool is_period_accepted(const posfet_board *board, uint32_t period_us) {
    return period_us >= board->config.shortest_period_us && period_us <= LONGEST_PERIOD_US &&
           period_us % board->config.period_step_us == 0;
}

static void set_period(posfet_board *board, uint32_t period_us) {
    if (period_us == board->period_us) return;
    board->period_us = period_us;
    board->header_due = true;
    // A tick whose time has passed comes now, and the next ones count from it.
    if (next_tick_us(board) < board->time_us) board->latest_tick_us = board->time_us - period_us;
}

static void self_test(posfet_board *board, posfet_response *response) {
    if (board->scanning && !board->config.tests_while_scanning) {
        response->result = POSFET_BUSY;
        return;
    }
    int16_t temperatures[2];
    uint16_t supply_mv;
    measure(board, temperatures, &supply_mv);
    const uint8_t found = (uint8_t)(board->measured_flags | (board->port.self_test(board->port.context) & 0x0FU));
    response->value = found;
    if (found != 0) response->result = POSFET_FAILED;
}

static void run_command(posfet_board *board, posfet_response *response, uint32_t argument) {
    if (response->command < POSFET_START || response->command > POSFET_SELF_TEST) {
        response->result = POSFET_UNKNOWN_COMMAND;
        return;
    }
    const bool accepted = response->command == POSFET_SET_RATE ? is_period_accepted(board, argument) : argument == 0;
    if (!accepted) {
        response->result = POSFET_BAD_ARGUMENT;
        return;
    }
    switch ((enum posfet_command)response->command) {
    case POSFET_START:
        if (!board->scanning) board->header_due = true;
        board->scanning = true;
        response->value = board->next_sequence;
        break;
    case POSFET_STOP:
        board->scanning = false;
        response->value = board->next_sequence;
        break;
    case POSFET_SET_RATE:
        set_period(board, argument);
        response->value = argument;
        break;
    case POSFET_IDENTIFY: {
        const posfet_identity identity = identity_of(board);
        response->value = posfet_identify_value(&identity);
        break;
    }
    case POSFET_SELF_TEST: self_test(board, response); break;
    }
}

bool posfet_board_receive(posfet_board *board, const posfet_frame *frame) {
    if (!is_command(board, frame)) return true;
    posfet_board_poll(board); // ticks that have passed come before the command
    if (queue_room(board) < FRAMES_PER_COMMAND) return false;
    posfet_response response = {
        .command = frame->data[0],
        .tag = frame->data[1],
        .result = POSFET_OK,
        .boot = board->config.boot,
        .value = 0,
    };
    run_command(board, &response, posfet_get_u32(frame->data + 4));
    posfet_encode_response(queue_append(board), board->config.base_id, &response);
    const bool identifies = response.command == POSFET_IDENTIFY || response.command == POSFET_SET_RATE;
    if (identifies && response.result == POSFET_OK) queue_identity(board);
    posfet_board_poll(board);
    return true;
}

void posfet_board_poll(posfet_board *board) {
    advance(board);
    queue_flush(board);
    run_scan_timer(board);
    if (run_report_timer(board, &board->next_status_us, STATUS_PERIOD_US)) queue_status(board);
    if (run_report_timer(board, &board->next_identity_us, IDENTITY_PERIOD_US)) queue_identity(board);
    queue_flush(board);
}

uint32_t posfet_board_due_in_us(const posfet_board *board) {
    uint64_t due = board->time_us + STATUS_PERIOD_US;
    if (queue_room(board) > 0) { // otherwise they wait for the controller, not for the clock
        if (board->next_status_us < due) due = board->next_status_us;
        if (board->next_identity_us < due) due = board->next_identity_us;
    }
    if (board->scanning && next_tick_us(board) < due) due = next_tick_us(board);
    return due > board->time_us ? (uint32_t)(due - board->time_us) : 0;
}

static bool is_possible(const posfet_config *config) {
    if (config->taxels == 0 || config->taxels > POSFET_MAX_TAXELS || config->layout_id == 0) return false;
    const bool fd_fits =
        config->base_id + POSFET_IDENTITY <= POSFET_HIGHEST_ID && posfet_fd_blocks(config->taxels) <= POSFET_FD_BLOCKS;
    const unsigned last_block = POSFET_SCAN_BLOCK + posfet_classic_blocks(config->taxels) - 1U;
    const bool classic_fits = config->base_id + last_block <= POSFET_HIGHEST_ID;
    return config->base_id <= POSFET_HIGHEST_ID && (config->fd ? fd_fits : classic_fits) &&
           config->shortest_period_us > 0 && config->shortest_period_us <= LONGEST_PERIOD_US &&
           config->period_step_us > 0 && config->shortest_period_us % config->period_step_us == 0;
}

bool posfet_board_init(posfet_board *board, const posfet_config *config, const posfet_port *port) {
    if (!is_possible(config)) return false;
    memset(board, 0, sizeof *board);
    board->config = *config;
    board->port = *port;
    board->clock = port->now_us(port->context);
    board->period_us = config->shortest_period_us;
    board->next_sequence = 1; // tick 0 is at power-on, before any command
    return true;
}
