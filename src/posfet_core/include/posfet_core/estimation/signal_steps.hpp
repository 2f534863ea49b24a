// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Steps of single signals, and how they differ from steps of the force.
///
/// A signal that steps by D has another offset from then on: the uncorrected force jumps by D, and its slope changes by
/// D/tau. A force that jumps has the same slope before and after. So each half of a window is fitted by a line. A force
/// that moves has jumps on several taxels at once: where more than one jumps, no signal steps.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/recycled.hpp"

namespace posfet {

/// Deviations of a jump from which on it is a step [1].
constexpr double kStep = 4.0;

/// Blocks of a window on either side of a step, with one between them [1].
constexpr std::size_t kStepHalf = 7;
constexpr std::size_t kStepWindow = 2 * kStepHalf + 1;

/// Courses of uncorrected forces.
struct StepWindow {
  Vector<double> time;          ///< Times of the blocks [s].
  Vector<const double*> force;  ///< Mean uncorrected forces of each block [N].
  const double* noise;          ///< Least variances of their noise [N2]: what the lines do not fit is noise.
  const bool* where;            ///< Taxels whose signals count.
};

/// Find the steps of single signals in the middle of a window [N], by their leakage time constants tau [s]; 0: none.
void find_signal_steps(const StepWindow& window, const std::vector<double>& time_constant, double* step);

}  // namespace posfet
