// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Vector table, and what runs before main().
#include "registers.h"

extern uint32_t data_begin[];
extern uint32_t data_end[];
extern uint32_t data_image[];
extern uint32_t bss_begin[];
extern uint32_t bss_end[];
extern uint32_t stack_top[];

int main(void);
void Reset_Handler(void);
void uart_interrupt(void);

// The board begins again, with the next boot number: a host sees that, and a silent board it would not.
static void fault(void) {
    RESET_CONTROL = RESET_REQUEST;
    for (;;) {
    }
}

static void wake(void) {}

void Reset_Handler(void) {
    const uint32_t *from = data_image;
    for (uint32_t *to = data_begin; to < data_end; to++)
        *to = *from++;
    for (uint32_t *to = bss_begin; to < bss_end; to++)
        *to = 0;
    main();
    fault();
}

typedef void (*handler)(void);

typedef struct {
    uint32_t *stack;
    handler exceptions[15];
    handler interrupts[32];
} vector_table;

__attribute__((section(".vectors"), used)) static const vector_table vectors = {
    stack_top,
    {Reset_Handler, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, wake},
    {[UART0_RX_IRQ] = uart_interrupt, [UART0_TX_IRQ] = uart_interrupt},
};
