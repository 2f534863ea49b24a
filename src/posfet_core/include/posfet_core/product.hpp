// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Products of rows and of small matrices, row by row.
#pragma once

#include <algorithm>
#include <cstddef>

namespace posfet {

/// out += a b for a row a of `count` values and a matrix b with as many rows, of `columns` values each.
void add_product(const double* row, const double* matrix, double* out, std::size_t count, std::size_t columns);

/// out += factor a for a row a of `count` values.
void add_scaled(double factor, const double* row, double* out, std::size_t count);

/// Sum of the products of two rows.
double dot(const double* one, const double* other, std::size_t count);

/// out = a b for matrices of [rows, inner] and [inner, columns] values.
inline void multiply(const double* left, const double* right, double* out, std::size_t rows, std::size_t inner,
                     std::size_t columns) {
  std::fill(out, out + rows * columns, 0.0);
  for (std::size_t row = 0; row < rows; ++row) {
    add_product(left + row * inner, right, out + row * columns, inner, columns);
  }
}

}  // namespace posfet
