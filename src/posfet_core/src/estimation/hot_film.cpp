// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/hot_film.hpp"

#include <cmath>

#include "posfet_core/estimation/unexplained_residuals.hpp"

namespace posfet {

namespace {

/// Greatest difference of temperature between an object and the film [K], assumed: a hand on a cold robot.
constexpr double kHottestObject = 15.0;

/// Time that a touch must last to show what it warms, in time constants of that warmth [1].
constexpr double kWarmingTimes = 2.0;

}  // namespace

void HotFilm::find_warm(const std::vector<double>& warmth, const TaxelFlags& beside,
                        const ContactSurroundings& surroundings) {
  for (std::size_t taxel = 0; taxel < warmth.size(); ++taxel) {
    near_[taxel] = warmth[taxel] > kWarmed || below_[taxel];
  }
  surroundings.dilate(near_, warm_);
  for (std::size_t taxel = 0; taxel < warmth.size(); ++taxel) {
    warm_[taxel] = warm_[taxel] || (hot_ && beside[taxel]);
  }
}

bool HotFilm::explains(const TaxelFlags& below, const std::vector<double>& force,
                       const std::vector<double>& newton_per_kelvin) {
  if (!begun_ || touched_for_ < UnexplainedResiduals::kNegativeTime) {  // as long as what it would explain
    return false;
  }
  bool hot = false;
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    const double kelvin = std::abs(force[taxel] / newton_per_kelvin[taxel]);  // infinite where there is no signal
    hot = hot || (below[taxel] && warm_[taxel] && kelvin < kHottestObject);
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
  if (!touches && touches_ && touched_for_ >= kWarmingTimes * warmth_time_) {
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
