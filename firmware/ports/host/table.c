// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#define _POSIX_C_SOURCE 200809L
#include "table.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

static bool read_number(char **text, uint64_t highest, uint64_t *value) {
    while (isspace((unsigned char)**text) || **text == ',')
        ++*text;
    if (!isdigit((unsigned char)**text)) return false;
    errno = 0;
    *value = strtoull(*text, text, 10);
    return errno == 0 && *value <= highest;
}

static bool grow(posfet_table *table, size_t *capacity) {
    if (table->rows < *capacity) return true;
    *capacity = *capacity ? 2 * *capacity : 64;
    uint64_t *times = realloc(table->times, *capacity * sizeof *times);
    if (times) table->times = times;
    uint16_t *counts = realloc(table->counts, *capacity * table->taxels * sizeof *counts);
    if (counts) table->counts = counts;
    return times && counts;
}

static bool read_row(posfet_table *table, char *text) {
    uint64_t value = 0;
    if (!read_number(&text, INT64_MAX, &value)) return false;
    if (table->rows > 0 && value <= table->times[table->rows - 1]) return false;
    table->times[table->rows] = value;
    for (size_t i = 0; i < table->taxels; i++) {
        if (!read_number(&text, UINT16_MAX, &value)) return false;
        table->counts[table->rows * table->taxels + i] = (uint16_t)value;
    }
    while (isspace((unsigned char)*text))
        text++;
    if (*text != '\0') return false;
    table->rows++;
    return true;
}

bool posfet_table_read(posfet_table *table, const char *path, size_t taxels) {
    *table = (posfet_table){.taxels = taxels};
    FILE *file = fopen(path, "r");
    if (!file) {
        perror(path);
        return false;
    }
    char *line = NULL;
    size_t size = 0;
    size_t capacity = 0;
    size_t number = 0;
    bool good = true;
    while (good && getline(&line, &size, file) >= 0) {
        number++;
        if (line[0] == '#' || line[0] == '\n') continue;
        good = grow(table, &capacity) && read_row(table, line);
    }
    free(line);
    fclose(file);
    if (good && table->rows >= 2 && table->times[0] == 0) return true;
    if (good)
        fprintf(stderr, "posfet_board: %s: at least two lines are needed, the first at time 0\n", path);
    else
        fprintf(stderr, "posfet_board: %s:%zu: a line is a time that is later than the last one, and %zu counts\n",
                path, number, taxels);
    return false;
}

void posfet_table_sample(const posfet_table *table, uint64_t time_us, uint16_t counts[]) {
    const uint64_t phase = time_us % table->times[table->rows - 1];
    size_t low = 0;
    size_t high = table->rows - 1;
    while (high - low > 1) {
        const size_t middle = low + (high - low) / 2;
        if (table->times[middle] <= phase)
            low = middle;
        else
            high = middle;
    }
    const int64_t span = (int64_t)(table->times[high] - table->times[low]);
    const int64_t passed = (int64_t)(phase - table->times[low]);
    const uint16_t *from = table->counts + low * table->taxels;
    const uint16_t *to = from + table->taxels;
    for (size_t i = 0; i < table->taxels; i++)
        counts[i] = (uint16_t)(from[i] + (to[i] - from[i]) * passed / span);
}
