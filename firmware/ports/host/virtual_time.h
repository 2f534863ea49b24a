// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// The board in virtual time, commanded by lines on standard input. docs/firmware.md lists them.
#ifndef POSFET_HOST_VIRTUAL_TIME_H
#define POSFET_HOST_VIRTUAL_TIME_H

#include "device.h"

// Runs until the end of the input. Returns the exit code of the process.
int posfet_run_virtual_time(const posfet_device_options *options, bool stamps);

#endif
