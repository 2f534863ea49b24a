// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#define _GNU_SOURCE // struct ifreq
#include "event_loop.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

typedef struct {
    posfet_device device;
    int fd;
} socketcan_link;

static bool send_frame(void *context, const posfet_frame *frame) {
    const socketcan_link *link = context;
    struct canfd_frame raw;
    memset(&raw, 0, sizeof raw);
    raw.can_id = frame->id;
    raw.len = frame->length;
    if (frame->flags & POSFET_RATE_SWITCH) raw.flags = CANFD_BRS;
    memcpy(raw.data, frame->data, frame->length);
    const size_t size = frame->flags & POSFET_FD ? CANFD_MTU : CAN_MTU;
    if (write(link->fd, &raw, size) == (ssize_t)size) return true;
    if (errno == EINVAL) { // more than the interface can carry
        fputs("posfet_board: the interface carries no CAN FD: ip link set IFACE mtu 72, or --format classic\n", stderr);
        exit(EXIT_FAILURE);
    }
    return false; // its queue is full, or it is down
}

static void run_frame(socketcan_link *link, const struct canfd_frame *raw, bool fd) {
    if (raw->can_id & CAN_ERR_FLAG) return;
    posfet_frame frame = {.id = raw->can_id & CAN_EFF_MASK, .length = raw->len};
    if (raw->can_id & CAN_EFF_FLAG) frame.flags |= POSFET_EXTENDED;
    if (raw->can_id & CAN_RTR_FLAG) frame.flags |= POSFET_REMOTE;
    if (fd) frame.flags |= POSFET_FD;
    if (frame.length > sizeof frame.data) return;
    memcpy(frame.data, raw->data, frame.length);
    // Without room for the response the frame is lost, as in a controller whose receive buffer is full.
    (void)posfet_board_receive(&link->device.board, &frame);
}

static bool receive(void *context) {
    socketcan_link *link = context;
    for (;;) {
        struct canfd_frame raw;
        memset(&raw, 0, sizeof raw);
        const ssize_t size = read(link->fd, &raw, sizeof raw);
        if (size == CAN_MTU || size == CANFD_MTU)
            run_frame(link, &raw, size == CANFD_MTU);
        else if (size < 0 && (errno == EAGAIN || errno == EINTR || errno == ENETDOWN))
            return true;
        else {
            perror("posfet_board: SocketCAN");
            return false;
        }
    }
}

static bool flush(void *context) {
    (void)context;
    return true;
}

static short events(void *context) {
    (void)context;
    return POLLIN;
}

static int open_interface(const char *name, bool fd) {
    const int raw = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (raw < 0) return -1;
    const int on = fd ? 1 : 0;
    if (fd && setsockopt(raw, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) != 0) return -1;
    struct sockaddr_can address;
    memset(&address, 0, sizeof address);
    address.can_family = AF_CAN;
    address.can_ifindex = (int)if_nametoindex(name);
    if (address.can_ifindex == 0) return -1;
    return bind(raw, (const struct sockaddr *)&address, sizeof address) == 0 ? raw : -1;
}

int posfet_run_socketcan(const posfet_device_options *options, const char *interface) {
    static socketcan_link link;
    if (!posfet_device_init(&link.device, options, send_frame, &link)) return EXIT_FAILURE;
    link.fd = open_interface(interface, options->config.fd);
    if (link.fd < 0) {
        fprintf(stderr, "posfet_board: %s: %s\n", interface, strerror(errno));
        return EXIT_FAILURE;
    }
    printf("%s\n", interface);
    fflush(stdout);
    const posfet_link events_of_link = {link.fd, &link, events, receive, flush};
    return posfet_run_event_loop(&link.device, &events_of_link);
}
