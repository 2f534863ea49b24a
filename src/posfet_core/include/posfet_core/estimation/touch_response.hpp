// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What a touch leaves in the signals besides its force: responses of leak, creep, warmth and bending to it.
///
/// All are simulated from the estimated force of the touched taxels, never from the measured signals: those are noise
/// at rest, which would explain everything.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "posfet_core/estimation/estimated_array.hpp"

namespace posfet {

/// Responses of the force errors to the shared states.
class TouchResponse {
public:
  /// An array that stays where it is.
  explicit TouchResponse(const EstimatedArray& array) : array_(&array) { reset(); }

  std::size_t taxels() const { return array_->taxels(); }

  /// Forget all touches.
  void reset();

  /// Whether anything has touched.
  bool responding() const { return responding_; }

  /// Warmth of each taxel relative to the steady one [1].
  const std::vector<double>& warm() const { return warm_; }

  /// By how much the greatest thermal contact that there may be differs from the least [1].
  const std::vector<double>& range() const { return range_; }

  /// By how much one taxel, or one object, differs in warmth from others, at a common warmth [K].
  double warmth_difference(double warmth) const;

  /// Variance of the warmth of a taxel about that, as a force [N2].
  double warmth_variance(std::size_t taxel, double warmth) const;

  /// Charge by which the film's hysteresis differs from that of the force, as a force [N].
  const std::vector<double>& loops() const { return loops_; }

  /// Rate of the chip temperature that the touch is expected to cause [K/s].
  double warming() const { return warming_; }

  /// Leaked charge of the touched force of a taxel, as a force [N].
  double leaked(std::size_t taxel) const { return force_[taxel] - charge_[taxel]; }

  /// Errors as far as the filter has estimated them.
  struct Known {
    double leak;    ///< Relative error of the leak rates [1], > -1: the charge leaks with tau*(1 + leak).
    double warmth;  ///< Warmth of a touched taxel [K].
  };

  /// Advance by a block [s] with the mean touched forces [N], 0 where untouched, and with what they are at `least` and
  /// at `most`.
  void advance(const std::vector<double>& force, const std::vector<double>& least, const std::vector<double>& most,
               double duration, const Known& known);

  /// Take what is left of the force of a taxel that was released [N] for the warmth of that force, as far as it was no
  /// other's, at a common warmth [K]. Without an expected one, what is left tells the warmth.
  void reduce_warmth(std::size_t taxel, double left, double warmth);

  /// Find the responses h of the force errors to the shared states, [taxels, states].
  void matrix(double* response) const;

private:
  void follow_loops(const std::vector<double>& force);

  const EstimatedArray* array_;
  bool responding_ = false;
  std::array<std::vector<double>, kCreeps> followed_;  ///< Force that creep follows with each time constant [N].
  std::vector<double> charge_;                         ///< Remaining charge of the touched force [N].
  std::vector<double> force_;                          ///< Touched force of the last block [N].
  std::array<std::vector<double>, kLoops> plays_;      ///< Play operators of the touched force [N].
  std::vector<double> loops_;
  std::array<double, kWarmings> warmed_{};  ///< Total force that the chip's warmth follows [N].
  double warming_ = 0.0;
  std::vector<double> warm_;
  std::vector<double> certain_;  ///< The same by what the forces were at least [1].
  std::vector<double> range_;
};

}  // namespace posfet
