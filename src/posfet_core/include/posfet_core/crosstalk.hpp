// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Compensation of electrical crosstalk: each taxel picks up a share of the signals of its four neighbours.
///
/// With a share c of each neighbour the signals are x = s + c*N s, N the sum over the four neighbours. On a grid N
/// separates into its two axes and is diagonalised by sines (discrete sine transform): the mode (j, k) of rows and
/// columns has the gain 1 + 2*c*(cos(pi*j/(rows + 1)) + cos(pi*k/(cols + 1))). The inverse is therefore one small
/// matrix on either side of the map, exactly. It is regularised by a limit on the gain, which shares up to 1/8 never
/// reach.
#pragma once

#include <vector>

#include "posfet_core/grid.hpp"

namespace posfet {

/// Largest amplification of a mode by the inverse [1].
constexpr double kMaxModeGain = 2.0;

/// Compensates the crosstalk of one array.
class CrosstalkCompensator {
public:
  /// `share` is the share c of each neighbour that a taxel picks up [1], in [0, 0.2].
  CrosstalkCompensator(const Layout& layout, double share);

  std::size_t taxels() const { return rows_ * cols_; }

  /// Whether there is crosstalk to compensate.
  bool present() const { return share_ > 0.0; }

  /// Compensate the crosstalk in the signals of all taxels, in any unit, in place.
  void apply(double* signal);

private:
  void transform(double* signal);

  std::size_t rows_;
  std::size_t cols_;
  double share_;
  std::vector<double> of_rows_;       ///< Modes of a column of taxels, [rows, rows]; symmetric, its own inverse.
  std::vector<double> of_cols_;       ///< Modes of a row of taxels, [cols, cols].
  std::vector<double> inverse_gain_;  ///< Of each mode [1], [rows, cols].
  std::vector<double> work_;
};

}  // namespace posfet
