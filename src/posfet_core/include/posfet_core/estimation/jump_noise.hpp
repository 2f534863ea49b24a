// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Noise that single taxels have beyond their description: steps of the signal.
#pragma once

#include <cstddef>
#include <vector>

namespace posfet {

/// Number of such differences that show the same step [1], with a block between the two.
constexpr double kStepSeen = 2.0;

/// Time for which no contact must have been listed [s]: the end of a release is no step.
constexpr double kQuiet = 0.3;

/// Mean time between two steps, for which an offset by one lasts [s], assumed.
constexpr double kDwell = 1.0;

/// Time over which the steps of a taxel are averaged [s].
constexpr double kJumpMemory = 30.0;

/// The least one after the start [s]: a single step in it counts for no more.
constexpr double kLeastJumpMemory = 2.0;

/// Random walk of each force error due to steps of its signal.
///
/// A signal that switches between two levels (random telegraph noise) has an offset that lasts for a while, in which
/// the integration adds up its charge. Over longer times that is a random walk of the force error, of the variance J*(1
/// + (D/(2*tau))^2) in each second, with the mean square of the steps in a second J and the time between them D, about
/// a drift: the offset that is observed is that of the present level, and its mean is half a step away, of the square
/// J*D/4.
class JumpNoise {
public:
  /// Leakage time constants tau [s], which stay where they are.
  explicit JumpNoise(const std::vector<double>& time_constant);

  std::size_t taxels() const { return tau_.size(); }

  /// Process the steps of the signals whose kind is certain [N] (`find_signal_steps`), of the taxels that count; and
  /// where there is none, while nothing touches, the changes of the mean forces from one block to the one after the
  /// next [N], with the variances of a mean [N2] and the time between two blocks that follow each other [s]. A step
  /// within the block in between is seen whole.
  void observe(const bool* where, const double* step, const double* change, const double* noise, double duration);

  /// Take a step of the signal of a taxel that was found otherwise [N]: one that steps does so again.
  void admit(std::size_t taxel, double step);

  /// Variance by which a force error grows in a time [s] [N2].
  double variance(std::size_t taxel, double duration) const;

  /// Least variance of an offset [N2]: that of its mean.
  double least_offset_variance(std::size_t taxel) const { return squares_[taxel] * (0.25 * kDwell); }

private:
  const std::vector<double>& tau_;
  std::vector<double> squares_;  ///< J [N2/s].
  std::vector<double> time_;     ///< Time of observation [s].
};

}  // namespace posfet
