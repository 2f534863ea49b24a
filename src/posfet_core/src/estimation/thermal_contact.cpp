// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/thermal_contact.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/estimation/release_detector.hpp"

namespace posfet {

ThermalContact::ThermalContact(std::size_t taxels, double warmth_time, double threshold)
    : warmth_time_(warmth_time),
      threshold_(threshold),
      readings_(kBlocks + 1, std::vector<double>(taxels, 0.0)),
      tends_(taxels, 0.0),
      cools_for_(taxels, ReleaseDetector::kReleasedBlocks) {}

void ThermalContact::reset() {
  seen_ = 0;
  cools_for_.reset();
}

void ThermalContact::update(const std::vector<double>& reading, double duration) {
  readings_[seen_ % readings_.size()] = reading;
  ++seen_;
  const std::vector<double>& oldest = readings_[seen_ % readings_.size()];
  const double left = std::exp(-static_cast<double>(kBlocks) * duration / warmth_time_);
  for (std::size_t taxel = 0; taxel < tends_.size(); ++taxel) {
    tends_[taxel] = (reading[taxel] - left * oldest[taxel]) / (1.0 - left);
  }
}

bool ThermalContact::warmed(std::size_t taxel) const {
  return known() && tends_[taxel] < kWarmed * newest()[taxel] &&
         std::all_of(readings_.begin(), readings_.end(), [&](const auto& each) { return each[taxel] < -threshold_; });
}

bool ThermalContact::find_left(const Vector<const Taxels*>& contacts, TaxelFlags& left) {
  return cools_for_.update(contacts, [&](const Taxels& contact) { return cools(contact); }, left.data());
}

bool ThermalContact::cools(const Taxels& contact) const {
  if (!known()) {
    return false;
  }
  double lowest = 0.0;
  double farthest = 0.0;
  for (const Taxel each : contact) {
    const auto taxel = static_cast<std::size_t>(each);
    lowest = std::min(lowest, newest()[taxel]);
    farthest = std::max(farthest, std::abs(tends_[taxel]));
  }
  return lowest < -threshold_ && farthest < -kLeft * lowest;
}

}  // namespace posfet
