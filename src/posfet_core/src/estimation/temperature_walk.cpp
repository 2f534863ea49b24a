// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/temperature_walk.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"

namespace posfet {

void TemperatureWalk::pause() {
  rate_ = kUnknown;
  rise_ = time_ = 0.0;
}

void TemperatureWalk::observe(double rise, double variance, double duration) {
  rise_ += rise;
  time_ += duration;
  if (time_ < kLeastTime) {
    return;
  }
  const double time = time_;
  const double before = rate_;
  rate_ = rise_ / time;
  rise_ = time_ = 0.0;
  if (std::isnan(before)) {
    return;
  }
  const double per_intensity = 2.0 * shown(time);
  const double noise = 6.0 * variance;
  // A rate that changes is no walk.
  const double most = kGate * kGate * (intensity_ * per_intensity + noise);
  const double difference = (rate_ - before) * time;
  const double square = std::min(difference * difference, most);
  count_ = std::min(count_ + 1, kMemory);
  intensity_ += ((square - noise) / per_intensity - intensity_) / count_;
  intensity_ = std::max(least_, intensity_);  // NaN does not stay
}

/// Time for which the film shows the walk of the chip within a time [s].
double TemperatureWalk::shown(double time) const {
  if (film_lag_ <= 0.0) {
    return time;
  }
  const double gone = -std::expm1(-time / film_lag_);
  return time - film_lag_ * gone * (1.0 + 0.5 * gone);
}

}  // namespace posfet
