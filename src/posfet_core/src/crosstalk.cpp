// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/crosstalk.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "posfet_core/numbers.hpp"
#include "posfet_core/product.hpp"

namespace posfet {

namespace {

constexpr double kGreatestShare = 0.2;

/// Modes of a line of taxels, [size, size].
std::vector<double> sines(std::size_t size) {
  std::vector<double> modes(size * size);
  const auto count = static_cast<double>(size + 1);
  for (std::size_t row = 0; row < size; ++row) {
    for (std::size_t col = 0; col < size; ++col) {
      modes[row * size + col] =
          std::sqrt(2.0 / count) * std::sin(kPi * static_cast<double>((row + 1) * (col + 1)) / count);
    }
  }
  return modes;
}

double along(std::size_t mode, std::size_t size) {
  return 2.0 * std::cos(kPi * static_cast<double>(mode + 1) / static_cast<double>(size + 1));
}

}  // namespace

CrosstalkCompensator::CrosstalkCompensator(const Layout& layout, double share)
    : rows_(static_cast<std::size_t>(layout.rows)), cols_(static_cast<std::size_t>(layout.cols)), share_(share) {
  const bool fits = layout.rows > 0 && layout.cols > 0 && share >= 0.0 && share <= kGreatestShare;
  if (!fits) {
    throw std::invalid_argument("share must be in [0, 0.2], and rows and cols at least 1");
  }
  of_rows_ = sines(rows_);
  of_cols_ = sines(cols_);
  for (std::size_t row = 0; row < rows_; ++row) {
    for (std::size_t col = 0; col < cols_; ++col) {
      const double gain = 1.0 + share * (along(row, rows_) + along(col, cols_));
      inverse_gain_.push_back(1.0 / std::max(gain, 1.0 / kMaxModeGain));
    }
  }
  work_.resize(taxels());
}

void CrosstalkCompensator::apply(double* signal) {
  transform(signal);
  for (std::size_t mode = 0; mode < taxels(); ++mode) {
    signal[mode] *= inverse_gain_[mode];
  }
  transform(signal);
}

/// To the modes, and back: the transform is its own inverse.
void CrosstalkCompensator::transform(double* signal) {
  multiply(of_rows_.data(), signal, work_.data(), rows_, rows_, cols_);
  multiply(work_.data(), of_cols_.data(), signal, rows_, cols_, cols_);
}

}  // namespace posfet
