// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What a block may have changed that the filter does not expect.
#pragma once

#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/contact_surroundings.hpp"
#include "posfet_core/estimation/estimated_array.hpp"
#include "posfet_core/estimation/force_covariance.hpp"
#include "posfet_core/estimation/jump_noise.hpp"
#include "posfet_core/estimation/moved_share.hpp"
#include "posfet_core/estimation/object_heating.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/estimation/unseen_release.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/force_integration.hpp"

namespace posfet {

/// Finds the process noise of each block: of the errors of the taxels, and of what they share.
///
/// Knows what of it counts from one block to the next: a film creeps as its force changes, its warmth differs from the
/// common one as far as it has grown, and no leak rate is less certain than at the greatest difference of temperature.
class ProcessNoise {
public:
  /// What a block shows; arrays have one value for each taxel.
  struct Shown {
    const Belief& belief;                 ///< Before the block.
    double earlier_rate;                  ///< Rate of the temperature some blocks ago [K/s].
    const TouchResponse& touch;           ///< After the block.
    const std::vector<double>& force;     ///< Force that follows the mean with a play [N].
    const ForceCovariance& covariance;    ///< Of the forces at the end of the last block.
    const std::vector<double>& reading;   ///< Variance of a reading [N2].
    const double* clipped;                ///< Variance of what leaked unseen while the signal was clipped [N2].
    const ForceIntegration& integration;  ///< The scans of the block.
    const JumpNoise& jumps;               ///< Steps of single signals.
    const UnseenRelease& unseen;          ///< Forces that left unseen.
    const TaxelFlags& was_touched;        ///< Taxels touched in the last block.
    bool may_be_hot;                      ///< Whether warmth may be hardly separable from force.
  };

  ProcessNoise(const EstimatedArray& array, const ContactSurroundings& surroundings);

  /// Find the noise of a block, and the share of its warmth that each taxel loses in it.
  void measure(Block& block, const Shown& shown);

  /// Variance of each force by steps of its signal since a touch began [N2].
  const std::vector<double>& stepped() const { return stepped_; }

  /// Forget the touch, and the temperature.
  void forget();

private:
  void add_signal_noise(Block& block, const Shown& shown);
  void add_warmth_noise(Block& block, const Shown& shown);
  void add_touch_noise(Block& block, const Belief& belief);
  void add_unknown_warmth(Block& block, const TaxelFlags& was_touched) const;
  void find_shared_noise(Block& block, const Shown& shown);

  const EstimatedArray& array_;
  const ContactSurroundings& surroundings_;
  MovedShare moved_share_;
  ObjectHeating heating_;
  double farthest_ = 0.0;          ///< Greatest difference from the temperature of the calibration [K].
  std::vector<double> stepped_;    ///< As `stepped`.
  std::vector<double> force_;      ///< Touched force of the block [N],
  std::vector<double> before_;     ///< and of the one before [N].
  std::vector<double> deviation_;  ///< Standard deviation of the force while something touches [N].
  std::vector<double> tail_;       ///< `Block::tail` of the last block [N].
  std::vector<double> warmth_;     ///< Greatest relative warmth of the taxels [1].
  std::vector<double> warmed_;     ///< Variance of the warmth of each taxel about the common one [N2].
};

}  // namespace posfet
