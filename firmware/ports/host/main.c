// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#define _POSIX_C_SOURCE 200809L
#include "event_loop.h"
#include "virtual_time.h"

#include <errno.h>
#include <getopt.h>
#include <stdlib.h>
#include <string.h>

static const char help[] =
    "usage: posfet_board [options]\n"
    "A readout board with simulated hardware. Without --can and --virtual it is a serial CAN adapter (slcan) on a\n"
    "pseudo-terminal, whose path is the first line of the output.\n"
    "  --can IFACE         on a SocketCAN interface\n"
    "  --virtual           in virtual time, commanded by lines on standard input (docs/firmware.md)\n"
    "  --stamps            with --virtual: the time before frames\n"
    "  --link PATH         a symbolic link to the pseudo-terminal\n"
    "  --format NAME       fd (default) or classic\n"
    "  --layout RxC        rows and columns, default 5x5\n"
    "  --layout-id N       default 1\n"
    "  --base-id N         default 0x100\n"
    "  --boot N            number of the power-on, default 0\n"
    "  --period US         shortest scan period, and the one after power-on, default 1000\n"
    "  --period-step US    periods that are no multiple of it are refused, default 1\n"
    "  --supply-low MV     SupplyLow below this supply, default 3000\n"
    "  --overtemperature C Overtemperature above it, default 85\n"
    "  --no-rate-switch    FD blocks without rate switch\n"
    "  --tests-beside      the self test can run while scanning\n"
    "  --peak MN           force of a press on the taxel in the middle, default 500\n"
    "  --noise N           largest noise [count], default 3\n"
    "  --seed N            of offsets and noise, default 1\n"
    "  --table FILE        counts from lines \"time_us count count ...\" in place of presses\n"
    "  --log FILE          write \"boot sequence time_us count count ...\" of each scan\n"
    "SIGHUP switches the board off and on.\n";

enum option_name {
    CAN = 256,
    VIRTUAL,
    STAMPS,
    LINK,
    FORMAT,
    LAYOUT,
    LAYOUT_ID,
    BASE_ID,
    BOOT,
    PERIOD,
    PERIOD_STEP,
    SUPPLY_LOW,
    OVERTEMPERATURE,
    NO_RATE_SWITCH,
    TESTS_BESIDE,
    PEAK,
    NOISE,
    SEED,
    TABLE,
    LOG,
    HELP,
};

static const struct option option_table[] = {
    {"can", required_argument, NULL, CAN},
    {"virtual", no_argument, NULL, VIRTUAL},
    {"stamps", no_argument, NULL, STAMPS},
    {"link", required_argument, NULL, LINK},
    {"format", required_argument, NULL, FORMAT},
    {"layout", required_argument, NULL, LAYOUT},
    {"layout-id", required_argument, NULL, LAYOUT_ID},
    {"base-id", required_argument, NULL, BASE_ID},
    {"boot", required_argument, NULL, BOOT},
    {"period", required_argument, NULL, PERIOD},
    {"period-step", required_argument, NULL, PERIOD_STEP},
    {"supply-low", required_argument, NULL, SUPPLY_LOW},
    {"overtemperature", required_argument, NULL, OVERTEMPERATURE},
    {"no-rate-switch", no_argument, NULL, NO_RATE_SWITCH},
    {"tests-beside", no_argument, NULL, TESTS_BESIDE},
    {"peak", required_argument, NULL, PEAK},
    {"noise", required_argument, NULL, NOISE},
    {"seed", required_argument, NULL, SEED},
    {"table", required_argument, NULL, TABLE},
    {"log", required_argument, NULL, LOG},
    {"help", no_argument, NULL, HELP},
    {NULL, 0, NULL, 0},
};

typedef struct {
    posfet_device_options device;
    const char *can;
    const char *link;
    bool virtual_time;
    bool stamps;
} arguments;

static void fail(const char *what, const char *text) {
    fprintf(stderr, "posfet_board: %s, got '%s'; --help lists the options\n", what, text);
    exit(2);
}

static uint32_t number(const char *what, const char *text, uint32_t lowest, uint32_t highest) {
    char *end = NULL;
    errno = 0;
    const unsigned long long value = strtoull(text, &end, 0);
    if (errno != 0 || end == text || *end != '\0' || *text == '-' || value < lowest || value > highest) {
        fprintf(stderr, "posfet_board: %s must be in [%lu, %lu], got '%s'\n", what, (unsigned long)lowest,
                (unsigned long)highest, text);
        exit(2);
    }
    return (uint32_t)value;
}

static void set_layout(posfet_device_options *device, const char *text) {
    unsigned rows = 0;
    unsigned cols = 0;
    int end = 0;
    if (sscanf(text, "%4ux%4u%n", &rows, &cols, &end) != 2 || text[end] != '\0' || rows == 0 || cols == 0 ||
        (unsigned long)rows * cols > POSFET_MAX_TAXELS) {
        fprintf(stderr, "posfet_board: --layout must be ROWSxCOLS with 1 to %d taxels, got '%s'\n", POSFET_MAX_TAXELS,
                text);
        exit(2);
    }
    device->press.rows = (uint16_t)rows;
    device->press.cols = (uint16_t)cols;
    device->config.taxels = (uint16_t)(rows * cols);
}

static void set_format(posfet_config *config, const char *text) {
    if (strcmp(text, "fd") != 0 && strcmp(text, "classic") != 0) fail("--format must be fd or classic", text);
    config->fd = strcmp(text, "fd") == 0;
}

static void set_option(arguments *chosen, int name, const char *text) {
    posfet_config *config = &chosen->device.config;
    posfet_press_config *press = &chosen->device.press;
    switch ((enum option_name)name) {
    case CAN: chosen->can = text; break;
    case VIRTUAL: chosen->virtual_time = true; break;
    case STAMPS: chosen->stamps = true; break;
    case LINK: chosen->link = text; break;
    case FORMAT: set_format(config, text); break;
    case LAYOUT: set_layout(&chosen->device, text); break;
    case LAYOUT_ID: config->layout_id = (uint16_t)number("--layout-id", text, 1, UINT16_MAX); break;
    case BASE_ID: config->base_id = number("--base-id", text, 0, POSFET_HIGHEST_ID); break;
    case BOOT: config->boot = (uint8_t)number("--boot", text, 0, 15); break;
    case PERIOD: config->shortest_period_us = number("--period", text, 1, 10000000); break;
    case PERIOD_STEP: config->period_step_us = number("--period-step", text, 1, 10000000); break;
    case SUPPLY_LOW: config->supply_low_mv = (uint16_t)number("--supply-low", text, 0, 65534); break;
    case OVERTEMPERATURE: config->overtemperature = (int16_t)(256 * number("--overtemperature", text, 0, 127)); break;
    case NO_RATE_SWITCH: config->rate_switch = false; break;
    case TESTS_BESIDE: config->tests_while_scanning = true; break;
    case PEAK: press->peak_mn = (int32_t)number("--peak", text, 0, 5000); break;
    case NOISE: press->noise = (int32_t)number("--noise", text, 0, 10000); break;
    case SEED: press->seed = number("--seed", text, 0, UINT32_MAX); break;
    case TABLE: chosen->device.table_path = text; break;
    case LOG: chosen->device.log_path = text; break;
    case HELP: fputs(help, stdout); exit(EXIT_SUCCESS);
    }
}

int main(int count, char *texts[]) {
    arguments chosen = {
        .device =
            {
                .config =
                    {
                        .base_id = 0x100,
                        .layout_id = 1,
                        .taxels = 25,
                        .fd = true,
                        .rate_switch = true,
                        .firmware_major = 1,
                        .shortest_period_us = 1000,
                        .period_step_us = 1,
                        .supply_low_mv = 3000,
                        .overtemperature = 85 * 256,
                    },
                // Counts per newton and leakage: of the sensor file posfet_5x5.
                .press = {.rows = 5,
                          .cols = 5,
                          .counts_per_newton = 5815,
                          .peak_mn = 500,
                          .leak_us = 270000,
                          .noise = 3,
                          .seed = 1},
            },
    };
    int name;
    while ((name = getopt_long(count, texts, "", option_table, NULL)) != -1) {
        if (name == '?') return 2;
        set_option(&chosen, name, optarg);
    }
    if (optind < count) fail("there is no such argument", texts[optind]);
    if (chosen.virtual_time) return posfet_run_virtual_time(&chosen.device, chosen.stamps);
    if (chosen.can) return posfet_run_socketcan(&chosen.device, chosen.can);
    return posfet_run_slcan(&chosen.device, chosen.link);
}
