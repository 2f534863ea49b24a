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
