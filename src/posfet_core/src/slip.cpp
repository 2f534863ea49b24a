// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/slip.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Least force of a contact by which another number is divided [N].
constexpr double kLeastTotal = 1e-9;

/// Sums of some values over the taxels of a contact: of the values, and of their products with x and y.
struct Plane {
  double sum = 0.0;
  double x = 0.0;
  double y = 0.0;
};

Plane plane(const Grid& grid, const Taxels& taxels, const double* values) {
  Plane found;
  for (const Taxel taxel : taxels) {
    found.sum += values[taxel];
    found.x += values[taxel] * grid.position(taxel).x;
    found.y += values[taxel] * grid.position(taxel).y;
  }
  return found;
}

}  // namespace

DynamicChannel::DynamicChannel(const Layout& layout, double noise)
    : grid_(layout),
      lever_(kLever * grid_.largest_pitch()),
      noise_(noise),
      high_passed_(static_cast<std::size_t>(grid_.taxels()), 0.0),
      power_(high_passed_) {}

void DynamicChannel::pause() {
  if (running_) {
    running_ = false;
    std::fill(high_passed_.begin(), high_passed_.end(), 0.0);
    std::fill(power_.begin(), power_.end(), 0.0);
    motions_.clear();
  }
}

void DynamicChannel::advance(const double* change, double step) {
  if (running_) {
    // Factors of the last value, and of a change at a constant rate over the step.
    const double passed = kTurn * kCornerFrequency * step;
    const double decay = std::exp(-passed);
    const double share = (1.0 - decay) / passed;
    for (std::size_t taxel = 0; taxel < high_passed_.size(); ++taxel) {
      high_passed_[taxel] = decay * high_passed_[taxel] + share * change[taxel];
    }
  }
  running_ = true;
}

void DynamicChannel::update_power(double step) {
  const double share = -std::expm1(-step / kPowerTimeConstant);
  for (std::size_t taxel = 0; taxel < power_.size(); ++taxel) {
    power_[taxel] += share * (high_passed_[taxel] * high_passed_[taxel] - power_[taxel]);
  }
}

const Motions& DynamicChannel::update(const Vector<Contact>& contacts, const double* force, double step) {
  Motions motions;
  for (const Contact& contact : contacts) {
    if (contact.state != ContactState::kReleased) {
      const auto known = motions_.find(contact.id);
      Motion motion = known == motions_.end() ? Motion{} : known->second;
      update_motion(motion, contact.region, force, step);
      motions[contact.id] = motion;
    }
  }
  motions_ = std::move(motions);
  return motions_;
}

void DynamicChannel::update_motion(Motion& motion, const Region& region, const double* force, double step) const {
  const Plane fast = plane(grid_, region.taxels, high_passed_.data());
  const Plane slow = plane(grid_, region.taxels, force);
  const double total = slow.sum > kLeastTotal ? slow.sum : kLeastTotal;
  motion.power += -std::expm1(-step / kPowerTimeConstant) * (fast.sum * fast.sum - motion.power);
  // The centre is that of these taxels alone, not the contact's centre of pressure.
  const double share = fast.sum / total;
  const double moment = std::hypot(fast.x - share * slow.x, fast.y - share * slow.y);
  const double per_speed = total / (kTurn * kCornerFrequency);
  const double noise = noise_moment(region);
  if (moment > kSlipSpeed * per_speed && moment > lever_ * std::abs(fast.sum) && std::abs(share) < kOnsetShare &&
      moment > noise) {
    motion.slipping = true;
    motion.still = 0.0;
  } else if (motion.slipping && moment < std::max(kSlipEndSpeed * per_speed, 0.5 * noise)) {
    motion.still += step;
    motion.slipping = motion.still < kSlipEndTime;
  }
}

/// Moment of a contact that noise may cause [N m].
double DynamicChannel::noise_moment(const Region& region) const {
  const double extent =
      std::hypot(region.axes.major.x, region.axes.major.y) + std::hypot(region.axes.minor.x, region.axes.minor.y);
  return kSlipNoiseDeviations * noise_ * extent * std::sqrt(static_cast<double>(region.taxels.size()));
}

}  // namespace posfet
