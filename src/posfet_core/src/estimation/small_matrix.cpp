// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/small_matrix.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "posfet_core/product.hpp"

namespace posfet {

void transpose(const SquareMatrix& matrix, SquareMatrix& out, std::size_t size) {
  out.resize(size * size);
  for (std::size_t row = 0; row < size; ++row) {
    for (std::size_t column = 0; column < size; ++column) {
      out[column * size + row] = matrix[row * size + column];
    }
  }
}

void mirror_lower(SquareMatrix& matrix, std::size_t size) {
  for (std::size_t row = 0; row < size; ++row) {
    for (std::size_t column = 0; column < row; ++column) {
      matrix[column * size + row] = matrix[row * size + column];
    }
  }
}

void replace_by_root(SquareMatrix& matrix, std::size_t size) {
  for (std::size_t row = 0; row < size; ++row) {
    double* mine = matrix.data() + row * size;
    for (std::size_t column = 0; column < row; ++column) {
      const double* other = matrix.data() + column * size;
      mine[column] = (mine[column] - dot(mine, other, column)) / other[column];
    }
    const double square = mine[row] - dot(mine, mine, row);
    const bool positive = square > 0.0;  // false for NaN
    if (!positive) {
      throw std::domain_error("a covariance must be positive");
    }
    mine[row] = std::sqrt(square);
    std::fill(mine + row + 1, mine + size, 0.0);
  }
}

void invert_lower(const SquareMatrix& lower, SquareMatrix& out, std::size_t size) {
  out.assign(size * size, 0.0);
  for (std::size_t row = 0; row < size; ++row) {
    const double* mine = lower.data() + row * size;
    double* inverse = out.data() + row * size;
    add_product(mine, out.data(), inverse, row, size);
    const double scale = -1.0 / mine[row];
    for (std::size_t column = 0; column < row; ++column) {
      inverse[column] *= scale;
    }
    inverse[row] = 1.0 / mine[row];
  }
}

void root_of_covariance(const SquareMatrix& covariance, std::size_t size, SquareMatrix& root, SquareMatrix& inverse) {
  Vector<double> deviation(size);
  Vector<double> weight(size);
  for (std::size_t state = 0; state < size; ++state) {
    deviation[state] = std::sqrt(std::max(covariance[state * size + state], 0.0));
    weight[state] = deviation[state] > 0.0 ? 1.0 / deviation[state] : 0.0;
  }
  root = covariance;
  for (std::size_t row = 0; row < size; ++row) {
    for (std::size_t column = 0; column < row; ++column) {
      root[row * size + column] *= weight[row] * weight[column];
    }
    root[row * size + row] = 1.0 + kNegligibleCorrelation;
  }
  replace_by_root(root, size);
  invert_lower(root, inverse, size);
  for (std::size_t row = 0; row < size; ++row) {
    for (std::size_t column = 0; column <= row; ++column) {
      root[row * size + column] *= deviation[row];
      inverse[row * size + column] *= weight[column];
    }
  }
}

}  // namespace posfet
