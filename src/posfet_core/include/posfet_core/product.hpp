// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Products of small matrices, row by row.
#pragma once

#include <algorithm>
#include <cstddef>

namespace posfet {

/// out += a b for a row a of `count` values and a matrix b with as many rows, of `columns` values each.
inline void add_product(const double* row, const double* matrix, double* out, std::size_t count, std::size_t columns) {
  std::size_t index = 0;
  for (; index + 4 <= count; index += 4) {  // four rows at a time: the result is read and written once for them
    const double one = row[index];
    const double two = row[index + 1];
    const double three = row[index + 2];
    const double four = row[index + 3];
    if (one == 0.0 && two == 0.0 && three == 0.0 && four == 0.0) {
      continue;  // transitions and regressions are sparse
    }
    const double* first = matrix + index * columns;
    const double* second = first + columns;
    const double* third = second + columns;
    const double* fourth = third + columns;
    std::size_t column = 0;
    for (; column + 2 <= columns; column += 2) {  // by two, which the compiler takes as one
      const double left =
          (one * first[column] + two * second[column]) + (three * third[column] + four * fourth[column]);
      const double right = (one * first[column + 1] + two * second[column + 1]) +
                           (three * third[column + 1] + four * fourth[column + 1]);
      out[column] += left;
      out[column + 1] += right;
    }
    for (; column < columns; ++column) {
      out[column] += (one * first[column] + two * second[column]) + (three * third[column] + four * fourth[column]);
    }
  }
  for (; index < count; ++index) {
    const double factor = row[index];
    const double* added = matrix + index * columns;
    for (std::size_t column = 0; column < columns; ++column) {
      out[column] += factor * added[column];
    }
  }
}

/// out = a b for matrices of [rows, inner] and [inner, columns] values.
inline void multiply(const double* left, const double* right, double* out, std::size_t rows, std::size_t inner,
                     std::size_t columns) {
  std::fill(out, out + rows * columns, 0.0);
  for (std::size_t row = 0; row < rows; ++row) {
    add_product(left + row * inner, right, out + row * columns, inner, columns);
  }
}

}  // namespace posfet
