// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Telegraph noise: a taxel whose signal switches between two levels at random.
///
/// The levels are constant, while the charge of a touch leaks: second differences do not show such noise, and a touch
/// does not look like it. In the means of blocks of 20 ms a level is where two consecutive blocks agree. A taxel
/// returns when its next level is the one that it had before the last; when it did so several times, and its neighbours
/// felt nothing of these steps, it has telegraph noise. Where there are too few neighbours, as in a corner, a return
/// counts when the charge of a force would have leaked clearly meanwhile, so that its release would have missed the
/// level. The taxel is cured when it has not returned for a while in which nothing touched: under a force that varies
/// no level comes again.
///
/// Steps of less than 8 standard deviations of a block's mean are not seen, nor levels that last for less than two
/// blocks.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/skin_response.hpp"

namespace posfet {

/// Standard deviations of a block's mean from which another mean is another level [1].
constexpr double kLeastLevelStep = 8.0;

/// Standard deviations of the difference of two blocks' means up to which they agree [1].
constexpr double kAgreeing = 4.0;

/// Part of a step by which the taxel may miss the level before [1], assumed.
constexpr double kLevelTolerance = 0.1;

/// Leaked charge of a force from which it would have missed the level clearly [tolerance].
constexpr double kLevelLeaked = 2.0;

/// Part of a step beyond the noise by which no neighbour changes [1]: half of what the sharpest tip lets it feel. In a
/// slide, neighbours change by as much.
constexpr double kNeighbourStep = 0.07;

/// Number of returns that identify telegraph noise [1], assumed: up, down and up again.
constexpr int kReturns = 2;

/// Time for which a return counts, and after which, while nothing touches, it has no more telegraph noise [s], assumed:
/// levels last for up to 2 s.
constexpr double kReturnMemory = 10.0;

/// Standard deviations by which the neighbours of a step must miss their part [1].
constexpr double kStepCertainty = 4.0;

/// Number of blocks over which a step is measured [1]: the two that agree, and one in between.
constexpr std::size_t kStepSpan = 4;

/// Tests the taxels of one array block by block. Signals are in one unit of the caller's choice.
class TelegraphDetector {
public:
  /// `skin` is what the neighbours of a pressed taxel must feel, `time_constant` that of the leakage [s].
  TelegraphDetector(const SkinResponse& skin, double time_constant);

  std::size_t taxels() const { return level_.size(); }

  /// Process a block: the mean signal of each taxel, the variance of that mean in their unit squared, the taxels
  /// without other faults, the duration of the block [s], and whether something touches the array.
  void close_block(const double* mean, const double* variance, const bool* sound, double duration, bool touched);

  /// Taxels with telegraph noise.
  TaxelFlags& found() { return found_; }
  const TaxelFlags& found() const { return found_; }

private:
  void find_returns(const double* variance, const bool* sound);
  bool has_returned(std::size_t taxel, const bool* sound) const;

  SkinResponse skin_;
  double time_constant_;
  std::vector<double> level_;   ///< The present level; NaN: none yet.
  std::vector<double> before_;  ///< The level before it.
  std::vector<int> returns_;    ///< Number of returns.
  std::vector<double> age_;     ///< Time since the last return [s].
  std::vector<double> quiet_;   ///< That time but for touches [s].
  std::vector<double> dwell_;   ///< Time on the level [s].
  std::vector<double> means_;   ///< Of the last blocks, the newest first, [kStepSpan, taxels].
  std::vector<double> change_;  ///< Over these blocks; 0: unknown.
  std::vector<double> step_variance_;
  std::vector<double> felt_;  ///< Size of the change of each sound taxel.
  TaxelFlags new_;            ///< Taxels on a new level.
  TaxelFlags found_;
};

}  // namespace posfet
