// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// How a belief goes on over a block.
#pragma once

#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/error_states.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"

namespace posfet {

/// By how much forces beside a contact differ from what they have in common, relative to the decline: as much as that
/// itself, which is far from its prior where forces do not decline geometrically: beside a pad.
double tail_spread(const ErrorPriors& priors, const Belief& belief);

/// Knows what a block is expected to change in a belief, and what a reading of the temperature sensors says of it.
///
/// Several beliefs go on side by side: the one that counts, the one without the hypothesis of a warmer film, and those
/// of the witnesses.
class Propagation {
public:
  /// What a reading of the sensors differs from its expectation by.
  struct Contradiction {
    double kelvin;      ///< Reading less expectation, after all that explains it [K].
    double deviations;  ///< Size of that in its deviations [1].
    double square;      ///< Square of that in its variance, before anything explains it [1],
    double spread;      ///< and the logarithm of that variance [1].
  };

  /// `observable`: whether zero forces determine the temperature of the film.
  Propagation(const EstimatedArray& array, bool observable);

  /// Propagate a belief over a block.
  void predict(ForceErrorFilter& filter, const Block& block);

  /// Update a belief by a new reading of the temperature sensors, if there is one; `zeros`: the belief has been updated
  /// by zero forces. Returns how it differs from what the belief expects, after all that explains it.
  ///
  /// An unexpected one shows that the rate changed, at least as if the sensors had no lag. While zero forces determine
  /// the temperature of the film, it may have warmed since before the start; soon after that, and not where something
  /// touches, which warms it, too. If neither explains it, it shows only that the sensors differ from their model, and
  /// is weighted down.
  Contradiction measure_temperature(ForceErrorFilter& filter, const Block& block, bool zeros);

  /// How the shared states change if the rate of the temperature changed by 1 K/s some time [s] ago, [states];
  /// overwritten by the next call.
  const std::vector<double>& maneuver(const Belief& belief, double duration) {
    return dynamics_.maneuver(belief.shared, duration);
  }

  /// Whether the rate of the temperature has changed since the oldest stored block by more than its dynamics let
  /// expect, as the forces rose: zeros of what a wide object presses do that, each by too little to be noticed.
  bool is_misled(const LastBlocks& blocks, const Belief& belief);

  /// Set the random walk of the temperature, and admit what it may have done that was weaker as far as was known
  /// [K2/s], at some time since the start [s]. As far as it can look like a drift of the offsets, it counted as one:
  /// the film warmed by less then, and zeros were the same.
  void admit_walk(ForceErrorFilter& filter, double walk, double known, double age);

  /// Rate of the film's temperature [K/s].
  double film_rate(const Belief& belief) const;

private:
  void expect_tail(SharedTransition& shared, const Belief& belief, const Block& block) const;

  const EstimatedArray& array_;
  bool observable_;
  SharedDynamics dynamics_;
};

}  // namespace posfet
