// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Small dense matrices, row by row: the covariance of a few states, and rows that belong to it.
#pragma once

#include <cstddef>

#include "posfet_core/recycled.hpp"

namespace posfet {

/// A square matrix, row by row.
using SquareMatrix = Vector<double>;

/// Added to the correlation of each state with itself [1]: correlations are positive within rounding, then.
constexpr double kNegligibleCorrelation = 1e-14;

/// Transposed matrix of `size` rows.
void transpose(const SquareMatrix& matrix, SquareMatrix& out, std::size_t size);

/// Make a matrix symmetric by its lower half.
void mirror_lower(SquareMatrix& matrix, std::size_t size);

/// Replace a symmetric matrix A, of which the lower half is read, by its lower root L with A = L L'. Throws
/// std::domain_error where A is not positive.
void replace_by_root(SquareMatrix& matrix, std::size_t size);

/// Inverse of a lower triangular matrix.
void invert_lower(const SquareMatrix& lower, SquareMatrix& out, std::size_t size);

/// Root L of a covariance L L', and L^-1 but for states that are known exactly: zero there. Throws std::domain_error
/// where the covariance is not positive.
void root_of_covariance(const SquareMatrix& covariance, std::size_t size, SquareMatrix& root, SquareMatrix& inverse);

}  // namespace posfet
