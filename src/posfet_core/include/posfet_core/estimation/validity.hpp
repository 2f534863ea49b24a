// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Contradictions in the estimated force: negative forces, and forces known only as a lower bound.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/flags.hpp"

namespace posfet {

/// Finds baseline errors: forces that stay negative and steady.
class NegativeForceMonitor {
public:
  /// Time for which a negative force must be steady to be a baseline error [s].
  NegativeForceMonitor(std::size_t taxels, double steady_time) : steady_time_(steady_time), steady_(taxels, 0.0) {}

  std::size_t taxels() const { return steady_.size(); }

  /// Process the mean forces of a block [N] of the taxels to be examined. A force below -limit is impossible [N];
  /// `still` are the taxels whose mean equals that of the block before within noise. Those whose force has been
  /// negative and steady for long enough are `confirmed`; returns whether there are any.
  bool update(const bool* where, const double* mean, double limit, const bool* still, double duration, bool* confirmed);

  /// Forget for how long forces have been negative.
  void reset();

private:
  double steady_time_;
  std::vector<double> steady_;  ///< Time below zero while steady [s].
};

/// Marks the taxels whose force is known only as a lower bound after an interruption, until the touch ends.
///
/// The remaining charge was caused by a force, so at least that force is applied. A negative charge means that the
/// force was released. Where neither remains, a force that leaked away cannot be distinguished from no force; after
/// `release_time` it counts as no force. Touches in between do not restart that time: where touches repeat, forces
/// would never be valid.
class LowerBoundMonitor {
public:
  /// Least measurable force [N]; time without a measurable force, in all, after which no force is applied [s].
  LowerBoundMonitor(std::size_t taxels, double threshold, double release_time)
      : mask_(taxels), threshold_(threshold), release_time_(release_time) {}

  /// Taxels whose force is a lower bound.
  const TaxelFlags& mask() const { return mask_; }

  /// Mark taxels after an interruption, from the forces before it and the remaining charges as forces [N].
  void start(const double* before, const double* remaining);

  /// Process the mean forces [N] of a block of `elapsed` [s].
  void update(const double* force, double elapsed);

  /// Mark no taxel.
  void clear() { mask_.fill(false); }

private:
  TaxelFlags mask_;
  double threshold_;
  double release_time_;
  double quiet_ = 0.0;  ///< Time without a measurable force since the interruption [s].
};

}  // namespace posfet
