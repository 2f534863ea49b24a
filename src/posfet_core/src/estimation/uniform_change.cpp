// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/uniform_change.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/medians.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

UniformChange::UniformChange(const std::vector<double>& newton_per_kelvin, double spread)
    : per_kelvin_(newton_per_kelvin),
      spread_(spread),
      observable_(per_kelvin_.size() >= kFewestForUniform &&
                  std::all_of(per_kelvin_.begin(), per_kelvin_.end(), [](double each) { return each != 0.0; })) {}

double UniformChange::temperature(const double* residual, const bool* where, const double* deviation, const double* own,
                                  double duration, bool noticed) {
  Vector<double> kelvins;
  Vector<double> deviations;
  Vector<double> own_deviations;
  double response = 0.0;
  for (std::size_t taxel = 0; taxel < per_kelvin_.size(); ++taxel) {
    if (where[taxel]) {
      kelvins.push_back(residual[taxel] / per_kelvin_[taxel]);
      deviations.push_back(deviation[taxel]);
      own_deviations.push_back(own[taxel]);
      response += per_kelvin_[taxel];
    }
  }
  if (!observable_ || kelvins.size() < kFewestForUniform) {
    return 0.0;
  }
  const auto count = static_cast<double>(kelvins.size());
  const double kelvin = median(kelvins);
  const double force = kelvin * response / count;  // mean of the taxels
  const double single = median(deviations);
  const double alone = median(own_deviations);
  const double shared = std::max(single * single - alone * alone, 0.0);
  const double least = (noticed ? kSurprising : kGate) * std::sqrt(shared + alone * alone / count);
  if (std::abs(force) < least) {
    return 0.0;
  }
  if (force < 0.0) {
    return kelvin;  // no object pulls at the whole array
  }
  int misfits = 0;
  for (std::size_t taxel = 0; taxel < per_kelvin_.size(); ++taxel) {
    const double expected = kelvin * per_kelvin_[taxel];
    const double tolerance = kSurprising * (spread_ * std::abs(expected) + own[taxel]);
    misfits += where[taxel] && std::abs(residual[taxel] - expected) > tolerance ? 1 : 0;
  }
  const bool fits = misfits <= kMisfits * count && std::abs(kelvin) <= kFastestWarming * duration;
  return fits && may_open() ? kelvin : 0.0;
}

bool UniformChange::is_refused(std::size_t odd, std::size_t judged, const Evidence& evidence, double duration) {
  pause_ = judged > 0 ? std::max(pause_ - duration, 0.0) : pause_;
  if (!open()) {
    return false;
  }
  open_ += duration;
  bool wrong = static_cast<double>(odd) > kMisfits * static_cast<double>(judged);
  if (open_ >= evidence.wait) {
    const auto [claimed, shown, deviation, negligible, wait] = evidence;
    const bool much = shown * claimed >= kConfirmed * claimed * claimed;
    const bool resolved = std::abs(claimed - shown) > kDistinct * deviation;
    wrong = wrong || (resolved && !much && std::abs(claimed) >= std::abs(shown));
    const bool confirmed = much && std::abs(shown) > kDistinct * deviation;
    if (resolved || confirmed || std::abs(claimed - shown) <= negligible) {
      close();
    }
  }
  return wrong;
}

void UniformChange::refuse() {
  close();
  pause_ = kPause;
}

}  // namespace posfet
