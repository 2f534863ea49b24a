// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Forces that have left, and of which nobody knew.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "posfet_core/estimation/error_states.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

/// Knows how much each film still recovers from a force that pressed it since before the start, and was released: no
/// response to a touch knows of it.
class UnseenRelease {
public:
  /// Time in which a film may recover by as much as it creeps [s], assumed.
  static constexpr double kRecovering = 1.0;

  /// Time constants after which the film is no longer warm [1].
  static constexpr double kCooled = 4.0;

  UnseenRelease(std::size_t taxels, const ErrorPriors& priors)
      : recovery_time_(priors.creep_times.back()), cooling_time_(kCooled * priors.warmth_time), force_(taxels, 0.0) {
    for (std::size_t each = 0; each < kCreeps; ++each) {
      creep_ += std::hypot(priors.creep_mean[each], priors.creep[each]);
    }
  }

  /// Let time pass [s].
  void pass(double time) { since_ += time; }

  /// Note that forces leave now; what is left of earlier ones counts with them.
  void begin() {
    const double left = recovery_left();
    for (double& force : force_) {
      force *= left;
    }
    since_ = 0.0;
  }

  /// Note that a force left a taxel [N], at the time of `begin`.
  void leave(std::size_t taxel, double force) { force_[taxel] = std::max(force_[taxel], force); }

  /// Whether the film of a taxel recovers: what it shows tells nothing of the others.
  bool recovers(std::size_t taxel) const { return force_[taxel] > 0.0 && since_ < cooling_time_; }

  /// Variance by which the force error of a taxel may grow in a time [s] as its film creeps back [N2].
  double variance(std::size_t taxel, double time) const {
    return force_[taxel] == 0.0 ? 0.0 : square(creep_ * recovery_left()) * (time / kRecovering) * square(force_[taxel]);
  }

  /// Forget the forces.
  void forget() { std::fill(force_.begin(), force_.end(), 0.0); }

private:
  /// Share of the recovery that is left [1].
  double recovery_left() const { return std::exp(-since_ / recovery_time_); }

  double recovery_time_;
  double cooling_time_;
  double creep_ = 0.0;         ///< By how much a film may creep back, relative to the force that left [1].
  std::vector<double> force_;  ///< Force that left each taxel, as the film had to recover from it then [N],
  double since_ = 0.0;         ///< and the time since then [s].
};

}  // namespace posfet
