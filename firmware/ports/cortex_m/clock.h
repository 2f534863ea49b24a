// Microseconds of a free-running timer, and an alarm that wakes the processor.
#ifndef POSFET_CLOCK_H
#define POSFET_CLOCK_H

#include <stdint.h>

void clock_init(void);

// To be read at least every 171 s, the period of the timer.
uint32_t clock_us(void);

// Wake from WFI after a time, or earlier.
void clock_alarm(uint32_t us);

#endif
