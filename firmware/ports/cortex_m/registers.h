// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Peripherals that this port uses, of the AN385 image of Arm's MPS2 board and of the Cortex-M3.
#ifndef POSFET_REGISTERS_H
#define POSFET_REGISTERS_H

#include <stdint.h>

#define CORE_CLOCK_HZ 25000000U

typedef struct {
    volatile uint32_t data;
    volatile uint32_t state;
    volatile uint32_t ctrl;
    volatile uint32_t interrupt; // read: pending, write 1: clear
    volatile uint32_t bauddiv;
} uart_registers;

enum { UART_TX_FULL = 1, UART_RX_FULL = 2 };                                                   // state
enum { UART_TX_ENABLE = 1, UART_RX_ENABLE = 2, UART_TX_INTERRUPT = 4, UART_RX_INTERRUPT = 8 }; // ctrl
enum { UART_TX_PENDING = 1, UART_RX_PENDING = 2 };                                             // interrupt

typedef struct {
    volatile uint32_t ctrl;
    volatile uint32_t value; // counts down
    volatile uint32_t reload;
    volatile uint32_t interrupt;
} timer_registers;

enum { TIMER_ENABLE = 1 };

typedef struct {
    volatile uint32_t ctrl;
    volatile uint32_t load;
    volatile uint32_t value;
} systick_registers;

enum { SYSTICK_ENABLE = 1, SYSTICK_INTERRUPT = 2, SYSTICK_CORE_CLOCK = 4, SYSTICK_LONGEST = 0xFFFFFF };

#define TIMER0        ((timer_registers *)0x40000000U)
#define UART0         ((uart_registers *)0x40004000U)
#define SYSTICK       ((systick_registers *)0xE000E010U)
#define NVIC_ENABLE   (*(volatile uint32_t *)0xE000E100U)
#define RESET_CONTROL (*(volatile uint32_t *)0xE000ED0CU)
#define RESET_REQUEST 0x05FA0004U

enum { UART0_RX_IRQ = 0, UART0_TX_IRQ = 1 };

#endif
