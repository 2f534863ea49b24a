// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/hidden_touch.hpp"

#include <cmath>

namespace posfet {

HiddenTouch::HiddenTouch(const EstimatedArray& array)
    : least_(kReads * array.threshold), brief_(kBrief * array.priors.warmth_time), pressed_(array.taxels()) {}

void HiddenTouch::follow_readings(const std::vector<double>& force, bool hides) {
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    pressed_[taxel] = pressed_[taxel] && hides && force[taxel] < -least_;
  }
}

void HiddenTouch::follow_touch(const TaxelFlags& touched, const std::vector<double>& force,
                               const ThermalContact& thermal, bool hides, double duration) {
  Taxels contact;
  bool presses = false;
  for (std::size_t taxel = 0; taxel < touched.size(); ++taxel) {
    if (touched[taxel]) {
      contact.push_back(static_cast<Taxel>(taxel));
      presses = presses || force[taxel] > least_ || !(std::abs(thermal.tends_to(taxel)) <= least_);  // NaN, too
    }
  }
  touched_for_ = contact.empty() ? 0.0 : touched_for_ + duration;
  cools_for_ = thermal.cools(contact) ? cools_for_ + 1 : 0;
  may_touch_ = cools_for_ < kCooling && (may_touch_ || (hides && presses && touched_for_ > brief_));
}

void HiddenTouch::forget() {
  may_touch_ = false;
  touched_for_ = 0.0;
  cools_for_ = 0;
  pressed_.fill(false);
}

}  // namespace posfet
