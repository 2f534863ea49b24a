// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/rest_noise.hpp"

#include <algorithm>

#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/estimation/signal_steps.hpp"
#include "posfet_core/medians.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

RestNoise::RestNoise(const EstimatedArray& array)
    : array_(array),
      jumps_(array.time_constant),
      walk_(array.priors.film_walk, array.film_lag),
      change_(array.taxels(), 0.0),
      step_(array.taxels(), 0.0) {}

void RestNoise::observe_steps(const LastBlocks& blocks, const Belief& belief, const TaxelFlags& counts, bool at_rest) {
  const Block& middle = blocks[kStepHalf];
  StepWindow window{blocks.times(), {}, middle.noise.data(), counts.data()};
  for (std::size_t index = 0; index < kStepWindow; ++index) {
    window.force.push_back(blocks[index].mean.data());
  }
  find_signal_steps(window, array_.time_constant, step_.data());
  std::fill(change_.begin(), change_.end(), 0.0);
  if (at_rest) {
    add_change(blocks[kStepHalf - 1], middle, belief, counts);
    const double kelvin = add_change(middle, blocks[kStepHalf + 1], belief, counts);
    for (std::size_t taxel = 0; taxel < change_.size(); ++taxel) {
      change_[taxel] -= array_.newton_per_kelvin[taxel] * kelvin;
    }
  }
  jumps_.observe(counts.data(), step_.data(), change_.data(), middle.noise.data(), middle.span);
}

void RestNoise::observe_walk(const LastBlocks& blocks, const Belief& belief, const TaxelFlags& counts) {
  std::fill(change_.begin(), change_.end(), 0.0);
  const Block& after = blocks[1];
  const double kelvin = add_change(blocks[0], after, belief, counts);
  double noise = 0.0;
  double count = 0.0;
  for (std::size_t taxel = 0; taxel < change_.size(); ++taxel) {
    if (counts[taxel]) {
      noise += after.noise[taxel] / square(array_.newton_per_kelvin[taxel]);
      count += 1.0;
    }
  }
  walk_.observe(kelvin, 0.5 * kPi * noise / square(count), after.span);  // that of a median
}

/// Add to `change_` how the mean forces changed from one block to the next, without what the offsets cause. Returns
/// what all that count have in common, as a change of the film's temperature [K].
double RestNoise::add_change(const Block& from, const Block& to, const Belief& belief, const TaxelFlags& counts) {
  Vector<double> kelvins;
  for (std::size_t taxel = 0; taxel < change_.size(); ++taxel) {
    const double time_constant = array_.time_constant[taxel];
    const double drift = offset_of(belief, taxel, time_constant) * to.leak / time_constant;
    change_[taxel] += to.mean[taxel] - from.mean[taxel] - to.span * drift;
    if (counts[taxel]) {
      kelvins.push_back(change_[taxel] / array_.newton_per_kelvin[taxel]);
    }
  }
  return upper_median(kelvins);
}

}  // namespace posfet
