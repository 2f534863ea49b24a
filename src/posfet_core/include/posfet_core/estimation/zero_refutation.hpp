// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// When the temperature sensors say that zeros are wrong, and until when.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>

#include "posfet_core/estimation/release_detector.hpp"

namespace posfet {

/// Decides whether something presses on all taxels, too slowly to be noticed.
///
/// Zeros of the taxels that it presses make a temperature of the film of its force, which the sensors do not show. They
/// are refuted by one reading that contradicts them in the direction of a press, where the rate of that temperature has
/// changed by more than its dynamics let expect; or by all readings of the last seconds, where these are far likelier
/// without any zeros than with them (`Witnesses`). What presses then is wide: all taxels are touched, however still,
/// until their total force has gone, or has not been significant for a while.
class ZeroRefutation {
public:
  /// Twice the logarithm of how much likelier readings must be without zeros [1]: a thousand times.
  static constexpr double kEvidence = 14.0;

  /// Deviations from which on the total force is significant, and a reading contradicts zeros that have changed the
  /// rate beyond its dynamics [1].
  static constexpr double kSignificant = 2.0;

  /// Share of the mean force from which on a taxel is pressed by what presses all [1].
  static constexpr double kPressed = 0.5;

  /// Time after which what is not significant is none [s], assumed.
  static constexpr double kMemory = 10.0;

  /// Whether zeros have been refuted, and what presses has not left since.
  bool wide() const { return wide_; }

  /// Whether the total force is significant.
  bool significant() const { return significant_; }

  /// Force of a touched taxel from which on it has not left, however still it is [N], where a total force [N] presses
  /// all of a number of taxels: what does that slowly is still. Infinite where nothing does.
  double pressed_force(double total, std::size_t taxels) const {
    const bool presses = significant_ && taxels > 0;
    return presses ? kPressed * total / static_cast<double>(taxels) : std::numeric_limits<double>::infinity();
  }

  /// Record that zeros have been refuted.
  void refute() {
    peak_ = wide_ ? peak_ : 0.0;
    insignificant_ = 0.0;
    wide_ = true;
  }

  /// Process the end of a block: its duration [s], and the total force with its deviation [N].
  void end_block(double duration, double total, double deviation) {
    significant_ = total > kSignificant * deviation;
    if (significant_) {
      peak_ = std::max(peak_, total);
      insignificant_ = 0.0;
      return;
    }
    insignificant_ += duration;
    if (total < ReleaseDetector::kReleasedShare * peak_ || insignificant_ >= kMemory) {
      wide_ = false;
    }
  }

  /// Forget what presses.
  void clear() { wide_ = false; }

private:
  bool wide_ = false;
  bool significant_ = false;
  double peak_ = 0.0;           ///< Greatest significant total force since zeros were refuted [N].
  double insignificant_ = 0.0;  ///< For how long it has not been significant [s].
};

}  // namespace posfet
