// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/unheated_belief.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "posfet_core/estimation/error_states.hpp"
#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

UnheatedBelief::UnheatedBelief(TouchResponse touch)
    : filter_(std::make_shared<Belief>(touch.taxels(), kSharedStates)),
      touch_(std::move(touch)),
      force_(touch_.taxels(), 0.0) {}

void UnheatedBelief::begin(const LastBlocks& blocks, Propagation& propagation, const TaxelFlags& ignored) {
  *filter_.belief() = blocks[0].before;
  touch_ = blocks[0].touch_before;
  for (std::size_t index = 0; index < blocks.size(); ++index) {
    follow(blocks[index], propagation, ignored);
  }
  // The change in the newest block is added when that is judged.
  const Block& newest = blocks.newest();
  rate_ = belief().shared[kRate];
  film_ = belief().shared[kFilm] - (rate_ + newest.warming) * newest.duration;
}

void UnheatedBelief::follow(const Block& block, Propagation& propagation, const TaxelFlags& ignored) {
  propagation.predict(filter_, block);
  propagation.measure_temperature(filter_, block, false);
  Vector<double> response(force_.size() * kSharedStates);
  touch_.matrix(response.data());
  filter_.forces(block.mean.data(), response.data(), force_.data());
  for (std::size_t taxel = 0; taxel < force_.size(); ++taxel) {
    force_[taxel] = ignored[taxel] ? 0.0 : std::max(force_[taxel], 0.0);
  }
  touch_.advance(force_, force_, force_, block.duration, known_errors(belief(), block));
}

UniformChange::Evidence UnheatedBelief::judge(const Block& block, double film, double negligible) {
  film_ += (rate_ + block.warming) * block.duration;
  UniformChange::Evidence evidence{};
  evidence.claimed = film - film_;
  evidence.shown = belief().shared[kFilm] - film_;
  evidence.deviation = std::sqrt(std::max(belief().variance(kFilm), 0.0));
  evidence.negligible = negligible;
  // By its own belief: the hypothesis itself makes the sensors' lag seem longer.
  evidence.wait = UniformChange::kConfirmation + 2.0 * SharedDynamics::sensor_lag(belief().shared);
  evidence.wait += std::isnan(block.reading) ? UniformChange::kInterval : 0.0;
  return evidence;
}

}  // namespace posfet
