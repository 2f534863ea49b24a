// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

// Whether what all taxels show is a change of the temperature, or a press.

#include <vector>

#include "posfet_core/estimation/force_estimator.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

/// By how much zeros of a wide object may have changed the film's temperature unnoticed since the oldest stored block
/// [K]. Not soon after a contact, whose release moves the rate, too.
double ForceEstimator::unnoticed_change() {
  if (!has_rested() || !propagation_.is_misled(blocks_, *belief())) {
    return 0.0;
  }
  const std::vector<double>& before = blocks_[0].before.shared;
  return belief()->shared[kFilm] - before[kFilm] - before[kRate] * blocks_.times().back();
}

/// Let the witnesses follow a block, and believe one with enough evidence where zeros have hidden a press since then:
/// something wide presses all taxels. Returns whether one is believed. Otherwise a new witness is called when it is
/// time.
///
/// They may tell a press from a film that cools where the lag of the sensors is calibrated, as it looks like a press
/// where the rate changes; no contact has just been released, whose warmth is in all zeros; and all offsets are known.
/// Not while the hypothesis of a warmer film is open, which has a witness of its own.
bool ForceEstimator::follow_witnesses(Block& block) {
  if (array_.priors.slow_rate <= 0.0 || rested_ < Witnesses::kSpacing || !state_.knows_offsets()) {
    witnesses_.clear();
    return false;
  }
  witnesses_.follow(block, propagation_);
  const Witness* witness = uniform_.open() ? nullptr : witnesses_.best(belief()->shared[kFilm], array_.per_kelvin);
  if (witness == nullptr) {
    witnesses_.call(*belief());
    return false;
  }
  witnesses_.replay(*witness, filter_, propagation_);
  ++processed_again_;
  refutation_.refute();
  block.touch_all(offset_known(), ignored());
  forget_blocks();
  return true;
}

/// Admit a change of the film's temperature where it explains residuals of a stored block that are not expected.
void ForceEstimator::explain_by_temperature(std::size_t index, Zeros& zeros) {
  const Block& block = blocks_[index];
  const bool listed = block.listed.any();
  if (!listed && block.touched.any()) {
    return;  // a touch has begun, and what follows is its own
  }
  bool noticed = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    noticed = noticed || (!listed && zeros.odd[taxel] && zeros.known[taxel]);
  }
  // While a contact grows, the rest of a wide object rises like a warmer film.
  const TaxelFlags& telling = listed ? zeros.known : zeros.judged;
  const double kelvin = uniform_.temperature(residuals_.values().data(), telling.data(), residuals_.deviation().data(),
                                             residuals_.own_deviation().data(), block.duration, noticed);
  if (kelvin == 0.0) {
    return;
  }
  if (kelvin * array_.per_kelvin > 0.0 && !listed && state_.knows_offsets() && !uniform_.open()) {
    uniform_.begin();
    unheated_.begin(blocks_, propagation_, ignored());
  }
  const std::vector<double>& direction = propagation_.maneuver(*belief(), block.duration);
  filter_.admit(direction.data(), square(kelvin / direction[kFilm]));
  residuals_.admit_warming(kelvin);
  residuals_.compare(filter_);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros.odd[taxel] = residuals_.is_odd(taxel, kelvin);
  }
}

/// Take the belief without the hypothesis, which was wrong.
void ForceEstimator::take_unheated(Block& block, Zeros& zeros) {
  *belief() = unheated_.belief();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    block.mean[taxel] -= unheated_.touch().loops()[taxel] - touch_.loops()[taxel];
  }
  touch_ = unheated_.touch();
  touch_.matrix(block.response.data());
  block.warming = touch_.warming();
  residuals_.take_forces(filter_, block);
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    zeros.odd[taxel] = zeros.judged[taxel] && residuals_[taxel] > 0.0;
  }
  forget_blocks();
}

}  // namespace posfet
