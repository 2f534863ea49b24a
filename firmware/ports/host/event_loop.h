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
