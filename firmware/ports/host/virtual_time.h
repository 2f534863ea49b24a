// The board in virtual time, commanded by lines on standard input. docs/firmware.md lists them.
#ifndef POSFET_HOST_VIRTUAL_TIME_H
#define POSFET_HOST_VIRTUAL_TIME_H

#include "device.h"

// Runs until the end of the input. Returns the exit code of the process.
int posfet_run_virtual_time(const posfet_device_options *options, bool stamps);

#endif
