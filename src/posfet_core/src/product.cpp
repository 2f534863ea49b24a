// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/product.hpp"

#include <array>

// Each of these functions is compiled twice, the second time for processors that calculate with four numbers at once;
// which one is used is decided as the library is loaded. The results are the same. Sanitizers are not ready by then.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define POSFET_FOUR_AT_ONCE __attribute__((target_clones("avx2", "default")))
#else
#define POSFET_FOUR_AT_ONCE
#endif

namespace posfet {

POSFET_FOUR_AT_ONCE
void add_product(const double* row, const double* matrix, double* __restrict out, std::size_t count,
                 std::size_t columns) {
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
    for (; column + 4 <= columns; column += 4) {
      for (std::size_t each = column; each < column + 4; ++each) {
        out[each] += (one * first[each] + two * second[each]) + (three * third[each] + four * fourth[each]);
      }
    }
    for (; column < columns; ++column) {
      out[column] += (one * first[column] + two * second[column]) + (three * third[column] + four * fourth[column]);
    }
  }
  for (; index < count; ++index) {
    add_scaled(row[index], matrix + index * columns, out, columns);
  }
}

POSFET_FOUR_AT_ONCE
void add_scaled(double factor, const double* row, double* __restrict out, std::size_t count) {
  std::size_t index = 0;
  for (; index + 4 <= count; index += 4) {
    for (std::size_t each = index; each < index + 4; ++each) {
      out[each] += factor * row[each];
    }
  }
  for (; index < count; ++index) {
    out[index] += factor * row[index];
  }
}

POSFET_FOUR_AT_ONCE
double dot(const double* one, const double* other, std::size_t count) {
  std::array<double, 4> sums{};  // side by side: no addition waits for the one before
  std::size_t index = 0;
  for (; index + sums.size() <= count; index += sums.size()) {
    for (std::size_t each = 0; each < sums.size(); ++each) {
      sums[each] += one[index + each] * other[index + each];
    }
  }
  for (; index < count; ++index) {
    sums[0] += one[index] * other[index];
  }
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

}  // namespace posfet
