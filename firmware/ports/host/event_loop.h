// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// The board in real time, behind a link to its bus.
#ifndef POSFET_HOST_EVENT_LOOP_H
#define POSFET_HOST_EVENT_LOOP_H

#include "device.h"

typedef struct {
    int fd;
    void *context;
    short (*events)(void *context); // what to wait for, of poll(); 0: for nothing
    bool (*receive)(void *context); // read what has arrived. False: the link is lost
    bool (*flush)(void *context);   // write what waits. False: the link is lost
} posfet_link;

// Runs until SIGINT or SIGTERM; SIGHUP switches the board off and on, with the next boot number. Returns the exit code
// of the process.
int posfet_run_event_loop(posfet_device *device, const posfet_link *link);

// Each runs the board on its kind of link.
int posfet_run_slcan(const posfet_device_options *options, const char *symbolic_link);
int posfet_run_socketcan(const posfet_device_options *options, const char *interface);

#endif
