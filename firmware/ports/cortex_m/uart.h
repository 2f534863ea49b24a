// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// The serial line, through rings that its interrupt empties and fills.
#ifndef POSFET_UART_H
#define POSFET_UART_H

#include <stdbool.h>
#include <stddef.h>

void uart_init(void);

// False: nothing has arrived.
bool uart_read(char *byte);

// All of it or nothing. False: no room, or no more than `reserve` bytes would be left.
bool uart_write(const char *bytes, size_t count, size_t reserve);

// Whether anything has arrived, for a caller with interrupts masked.
bool uart_has_input(void);

#endif
