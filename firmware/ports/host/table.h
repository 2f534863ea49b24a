// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Counts from a file: lines of a time [us] and the count of each taxel, in ascending time, repeated without end.
#ifndef POSFET_HOST_TABLE_H
#define POSFET_HOST_TABLE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    size_t rows;
    size_t taxels;
    uint64_t *times; // [us]
    uint16_t *counts;
} posfet_table;

// False: no such file, or it is malformed; the reason is on stderr.
bool posfet_table_read(posfet_table *table, const char *path, size_t taxels);

// Counts at a time, between two lines on the straight line. The last line is the end of the period, so it repeats the
// counts of the first one in a signal without a step.
void posfet_table_sample(const posfet_table *table, uint64_t time_us, uint16_t counts[]);

#endif
