// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/hot_film.hpp"

#include <cmath>

#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/estimation/unexplained_residuals.hpp"

namespace posfet {

namespace {

/// Greatest difference of temperature between an object and the film [K], assumed: a hand on a cold robot.
constexpr double kHottestObject = 15.0;

/// Time that a touch must last to show what it warms, in time constants of that warmth [1].
constexpr double kWarmingTimes = 2.0;

}  // namespace

bool HotFilm::may_be_hot(const Belief& belief) const {
  return hot_ || std::abs(belief.shared[kWarmth]) + std::sqrt(belief.variance(kWarmth)) > kGreatestWarmth;
}

const TaxelFlags& HotFilm::find_warm(const std::vector<double>& warmth, const TaxelFlags& beside) {
  TaxelFlags near(warm_.size());
  for (std::size_t taxel = 0; taxel < near.size(); ++taxel) {
    near[taxel] = warmth[taxel] > kWarmed || below_[taxel];
  }
  surroundings_.dilate(near, warm_);
  for (std::size_t taxel = 0; taxel < near.size(); ++taxel) {
    warm_[taxel] = warm_[taxel] || (hot_ && beside[taxel]);
  }
  return warm_;
}

bool HotFilm::explains(const TaxelFlags& below, const std::vector<double>& force, const std::vector<double>& warmth,
                       const TaxelFlags& beside) {
  if (!begun_ || touched_for_ < UnexplainedResiduals::kNegativeTime) {  // as long as what it would explain
    return false;
  }
  const TaxelFlags& warm = find_warm(warmth, beside);
  bool hot = false;
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    const double kelvin =
        std::abs(force[taxel] / array_.newton_per_kelvin[taxel]);  // infinite where there is no signal
    hot = hot || (below[taxel] && warm[taxel] && kelvin < kHottestObject);
  }
  hot_ = hot_ || hot;
  shown_ = shown_ || hot;
  return hot;
}

void HotFilm::follow(bool touches, double duration) {
  if (touches && !touches_) {
    begun_ = true;
    shown_ = false;
    touched_for_ = 0.0;
  }
  if (!touches && touches_ && touched_for_ >= kWarmingTimes * array_.priors.warmth_time) {
    hot_ = shown_;
  }
  touched_for_ += touches ? duration : 0.0;
  touches_ = touches;
}

void HotFilm::interrupt() {
  begun_ = false;
  touches_ = true;
}

void HotFilm::forget() {
  hot_ = shown_ = touches_ = begun_ = false;
  touched_for_ = 0.0;
  below_.fill(false);
}

}  // namespace posfet
