// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "uart.h"

#include "registers.h"

enum { INPUT = 256, OUTPUT = 2048, BAUDRATE = 1562500 }; // powers of two; the fastest rate that 25 MHz gives

static volatile uint32_t input_first, input_last;
static volatile uint32_t output_first, output_last;
static char input[INPUT];
static char output[OUTPUT];

void uart_interrupt(void);

// With the interrupt masked, or in it.
static void transmit(void) {
    while (output_first != output_last && !(UART0->state & UART_TX_FULL)) {
        UART0->data = (uint8_t)output[output_first % OUTPUT];
        output_first++;
    }
}

void uart_interrupt(void) {
    UART0->interrupt = UART_TX_PENDING | UART_RX_PENDING;
    while (UART0->state & UART_RX_FULL) {
        const char byte = (char)(UART0->data & 0xFFU);
        // A byte too many is lost; the adapter refuses its line, and the host repeats the command.
        if (input_last - input_first < INPUT) {
            input[input_last % INPUT] = byte;
            input_last++;
        }
    }
    transmit();
}

void uart_init(void) {
    UART0->bauddiv = CORE_CLOCK_HZ / BAUDRATE;
    UART0->ctrl = UART_TX_ENABLE | UART_RX_ENABLE | UART_TX_INTERRUPT | UART_RX_INTERRUPT;
    NVIC_ENABLE = 1U << UART0_RX_IRQ | 1U << UART0_TX_IRQ;
}

bool uart_has_input(void) {
    return input_first != input_last;
}

bool uart_read(char *byte) {
    if (!uart_has_input()) return false;
    *byte = input[input_first % INPUT];
    input_first++;
    return true;
}

bool uart_write(const char *bytes, size_t count, size_t reserve) {
    if (OUTPUT - (output_last - output_first) < count + reserve) return false;
    uint32_t last = output_last;
    for (size_t i = 0; i < count; i++)
        output[last++ % OUTPUT] = bytes[i];
    output_last = last;
    __asm volatile("cpsid i" ::: "memory");
    transmit();
    __asm volatile("cpsie i" ::: "memory");
    return true;
}
