// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Taxels whose residuals no state explains.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/flags.hpp"

namespace posfet {

/// Taxels whose residual no state explains: they are left out until they are explained, or known to be errors.
class UnexplainedResiduals {
public:
  /// Blocks over which residuals are averaged [1]: what errors leave of them in the filter is white.
  static constexpr int kPersistentBlocks = 16;

  /// A negative force that lasts for this long is an error of the baseline [s]: no object pulls.
  static constexpr double kNegativeTime = 0.2;

  /// A small positive force that is steady for this long, without a contact, is an error of the baseline [s].
  static constexpr double kUnexplainedTime = 2.0;

  /// Such a force is small below this share of the contact threshold [1].
  static constexpr double kSmall = 0.25;

  /// Contact threshold [N].
  UnexplainedResiduals(std::size_t taxels, double threshold);

  /// Taxels with a positive residual: a touch may begin there.
  const TaxelFlags& rising() const { return rising_; }

  /// Time for which each taxel has been below zero [s].
  const std::vector<double>& below() const { return below_; }

  /// Process a block: add to a mask the taxels whose residuals have been positive in too many blocks. A slow press
  /// raises each of them by less than the noise. `where` are the taxels whose residuals count; these are in units of
  /// their expected deviations [1].
  void add_persistent(const bool* where, const double* residual, bool* odd);

  /// Process a block of `duration` [s]: residuals [N] that are unexplained where `odd`, uncorrected mean forces [N] and
  /// the standard deviations of these [N]. The taxels whose residual is an error of the baseline are marked.
  void update(const bool* odd, const double* residual, const double* mean, const double* noise, double duration,
              bool* errors);

  /// Forget everything but the averages.
  void reset();

private:
  double small_;
  TaxelFlags rising_;
  std::vector<double> below_;
  std::vector<double> steady_;  ///< Time for which each taxel has been steady above zero [s].
  std::vector<double> level_;   ///< Mean since when it has been [N].
  std::vector<double> mean_;    ///< Average residual [1].
};

}  // namespace posfet
