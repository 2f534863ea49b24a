// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// By how much the forces of a block differ from what the filter expects of them.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/flags.hpp"

namespace posfet {

/// Taxels of a block, as its zeros count.
struct Zeros {
  explicit Zeros(std::size_t taxels) : judged(taxels), faulty(taxels), known(taxels), odd(taxels) {}

  TaxelFlags judged;  ///< Taxels whose residual counts,
  TaxelFlags faulty;  ///< and faulty ones in no contact, which say nothing of the others.
  TaxelFlags known;   ///< Taxels whose force is known to be none, or small.
  TaxelFlags odd;     ///< Taxels whose residual is unexplained.
};

/// Knows what each taxel measures of the errors if its force is none, or a small one beside a contact; how that
/// responds to the shared states; and what is left of it beyond the belief.
class BlockResiduals {
public:
  explicit BlockResiduals(const EstimatedArray& array);

  /// Expect no force, and small ones beside a contact.
  void expect_small_forces(const Block& block, const Belief& belief, const TouchResponse& touch);

  /// Expect no force: but for one as small as a tail's noise.
  void expect_release(const Block& block);

  /// Find the residuals for a belief.
  void compare(const ForceErrorFilter& filter);

  /// Take the forces of a block themselves for residuals.
  void take_forces(const ForceErrorFilter& filter, const Block& block);

  /// Let the film have warmed [K]: the taxels' responses to that are not quite known.
  void admit_warming(double kelvin);

  /// Residuals [N].
  const std::vector<double>& values() const { return values_; }
  double operator[](std::size_t taxel) const { return values_[taxel]; }

  /// Their expected deviations [N], and those of what the taxels do not share [N].
  const std::vector<double>& deviation() const { return deviation_; }
  const std::vector<double>& own_deviation() const { return own_deviation_; }

  /// Whether the residual of a taxel is not expected, and whether it is not where the film has warmed [K].
  bool is_odd(std::size_t taxel) const;
  bool is_odd(std::size_t taxel, double kelvin) const;

  /// Where zeros of what was touched show a film that is warmer than all that is believed of the common warmth, as no
  /// object pulls, that belief was wrong since the touch began: widen it, and the errors of the forces by it.
  void admit_warmer_object(ForceErrorFilter& filter, const TaxelFlags& zeros, const TouchResponse& touch);

  /// Update the belief by some taxels.
  void update(ForceErrorFilter& filter, const TaxelFlags& where) const;

  /// Update some taxels, of which nothing follows for the others, by what is left of their residuals.
  void update_alone(ForceErrorFilter& filter, const TaxelFlags& where) const;

  /// Find what is left of the residuals after an update by some taxels, in units of its expected deviation [1], where
  /// the film warms at some rate [K/s] for a time [s]: the taxels' responses to that are not quite known.
  void find_left(const ForceErrorFilter& filter, const TaxelFlags& updated, double rate, double time,
                 double* left) const;

private:
  const EstimatedArray& array_;
  std::vector<double> measured_;     ///< Errors of the forces as measured [N].
  std::vector<double> response_;     ///< Their responses to the shared states, [taxels, states].
  std::vector<double> noise_;        ///< Variance of their noise [N2].
  std::vector<double> values_;       ///< Residuals [N].
  std::vector<double> sensitivity_;  ///< Their sensitivities to the shared states, [taxels, states].
  std::vector<double> deviation_;
  std::vector<double> own_deviation_;
};

}  // namespace posfet
