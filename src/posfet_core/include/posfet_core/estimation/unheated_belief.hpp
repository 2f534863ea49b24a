// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What is believed without the hypothesis of a warmer film.
#pragma once

#include <vector>

#include "posfet_core/estimation/belief.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/estimation/force_error_filter.hpp"
#include "posfet_core/estimation/propagation.hpp"
#include "posfet_core/estimation/touch_response.hpp"
#include "posfet_core/estimation/uniform_change.hpp"
#include "posfet_core/flags.hpp"

namespace posfet {

/// While the hypothesis that the film became warmer is open (`UniformChange`), the other one goes on beside it: that a
/// touch of all taxels has begun. Knows the belief and the touch that there are then, and what the film's temperature
/// would be had nothing changed, against which both claim a change.
class UnheatedBelief {
public:
  /// Responses to a touch of this array.
  explicit UnheatedBelief(TouchResponse touch);

  /// Begin as if a touch of all taxels had begun with the stored blocks.
  void begin(const LastBlocks& blocks, Propagation& propagation, const TaxelFlags& ignored);

  /// Follow a block: the belief, and what the touch leaves that there is without the hypothesis.
  void follow(const Block& block, Propagation& propagation, const TaxelFlags& ignored);

  /// What the sensors say of the hypothesis, with which the film has some temperature [K], at the end of a block;
  /// `negligible`: change of that temperature that makes no difference to the forces [K].
  UniformChange::Evidence judge(const Block& block, double film, double negligible);

  const Belief& belief() const { return *filter_.belief(); }
  const TouchResponse& touch() const { return touch_; }

private:
  ForceErrorFilter filter_;
  TouchResponse touch_;
  std::vector<double> force_;  ///< Forces of that touch [N].
  double film_ = 0.0;          ///< Temperature of the film without any change of its rate [K],
  double rate_ = 0.0;          ///< which is this one [K/s].
};

}  // namespace posfet
