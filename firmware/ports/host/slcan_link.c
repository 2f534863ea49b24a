// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#define _GNU_SOURCE // ptsname, cfmakeraw
#include "event_loop.h"

#include "slcan.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

// Output that may wait: what frames leave free is for replies.
// A megabyte is 7 s of the largest stream of 5 x 5 taxels, longer than a busy machine keeps a reader waiting.
enum { OUTPUT_FOR_FRAMES = 1 << 20, OUTPUT_BYTES = OUTPUT_FOR_FRAMES + (1 << 14), INPUT_BYTES = 1 << 10 };

typedef struct {
    posfet_device device;
    int fd;
    bool hung_up; // nobody has the terminal open
    posfet_slcan adapter;
    bool frame_waits; // adapter.frame, for which the board had no room
    size_t output_first;
    size_t output_end;
    char output[OUTPUT_BYTES];
    size_t input_first;
    size_t input_length;
    char input[INPUT_BYTES];
} slcan_link;

static size_t waiting(const slcan_link *link) {
    return link->output_end - link->output_first;
}

// The place of the next output, with room for a line in any case.
static char *place(slcan_link *link) {
    if (link->output_first > 0 && link->output_end + POSFET_SLCAN_LINE > OUTPUT_BYTES) {
        memmove(link->output, link->output + link->output_first, waiting(link));
        link->output_end -= link->output_first;
        link->output_first = 0;
    }
    return link->output + link->output_end;
}

static bool send_frame(void *context, const posfet_frame *frame) {
    slcan_link *link = context;
    if (!link->adapter.open) return true; // on the bus, where nobody listens
    if (waiting(link) + POSFET_SLCAN_LINE > OUTPUT_FOR_FRAMES) return false;
    link->output_end += posfet_slcan_format(frame, place(link));
    return true;
}

static void hang_up(slcan_link *link) {
    link->hung_up = true;
    link->output_first = link->output_end = 0;
    link->input_length = 0;
    link->frame_waits = false;
    posfet_slcan_init(&link->adapter);
}

static bool flush(void *context) {
    slcan_link *link = context;
    while (waiting(link) > 0) {
        const ssize_t written = write(link->fd, link->output + link->output_first, waiting(link));
        if (written <= 0) return true; // no room, or hung up, which reading tells
        link->output_first += (size_t)written;
    }
    link->output_first = link->output_end = 0;
    return true;
}

static short events(void *context) {
    const slcan_link *link = context;
    if (link->hung_up) return 0;
    return (short)((link->frame_waits ? 0 : POLLIN) | (waiting(link) > 0 ? POLLOUT : 0));
}

// Takes input until it is used up, or waits for the board or for output.
static void run_input(slcan_link *link) {
    if (link->frame_waits && !posfet_board_receive(&link->device.board, &link->adapter.frame)) return;
    link->frame_waits = false;
    while (link->input_length > 0 && waiting(link) + POSFET_SLCAN_LINE <= OUTPUT_BYTES) {
        const char byte = link->input[link->input_first++];
        link->input_length--;
        const enum posfet_slcan_event event = posfet_slcan_take(&link->adapter, byte);
        if (event == POSFET_SLCAN_NOTHING) continue;
        const size_t length = strlen(link->adapter.reply);
        memcpy(place(link), link->adapter.reply, length);
        link->output_end += length;
        if (event == POSFET_SLCAN_SEND && !posfet_board_receive(&link->device.board, &link->adapter.frame)) {
            link->frame_waits = true;
            return;
        }
    }
}

static bool receive(void *context) {
    slcan_link *link = context;
    for (;;) {
        run_input(link);
        if (link->frame_waits || link->input_length > 0) return true;
        const ssize_t count = read(link->fd, link->input, sizeof link->input);
        if (count > 0) {
            link->hung_up = false;
            link->input_first = 0;
            link->input_length = (size_t)count;
        } else if (count < 0 && errno == EINTR) {
            continue;
        } else if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
            link->hung_up = false;
            return true;
        } else { // EIO
            hang_up(link);
            return true;
        }
    }
}

static int open_terminal(const char **name) {
    const int fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (fd < 0 || grantpt(fd) != 0 || unlockpt(fd) != 0 || !(*name = ptsname(fd))) return -1;
    const int terminal = open(*name, O_RDWR | O_NOCTTY);
    if (terminal < 0) return -1;
    struct termios settings;
    if (tcgetattr(terminal, &settings) != 0) return -1;
    cfmakeraw(&settings);
    if (tcsetattr(terminal, TCSANOW, &settings) != 0) return -1;
    close(terminal);
    return fd;
}

int posfet_run_slcan(const posfet_device_options *options, const char *symbolic_link) {
    static slcan_link link; // too large for a stack with the largest layout
    const char *name = NULL;
    if (!posfet_device_init(&link.device, options, send_frame, &link)) return EXIT_FAILURE;
    link.fd = open_terminal(&name);
    if (link.fd < 0) {
        perror("posfet_board: no pseudo-terminal");
        return EXIT_FAILURE;
    }
    hang_up(&link);
    if (symbolic_link) {
        unlink(symbolic_link);
        if (symlink(name, symbolic_link) != 0) {
            perror(symbolic_link);
            return EXIT_FAILURE;
        }
        name = symbolic_link;
    }
    printf("%s\n", name);
    fflush(stdout);
    const posfet_link events_of_link = {link.fd, &link, events, receive, flush};
    const int code = posfet_run_event_loop(&link.device, &events_of_link);
    if (symbolic_link) unlink(symbolic_link);
    return code;
}
