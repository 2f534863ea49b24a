// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/scan_path.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "posfet_core/neighbour_estimate.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

std::size_t size_of(const Grid& grid) { return static_cast<std::size_t>(grid.taxels()); }

bool fit_together(const ScanParts& parts, std::size_t taxels) {
  return parts.clock && parts.crosstalk && parts.bursts && parts.hum && parts.integration && parts.history &&
         parts.finder && parts.tracker && parts.channel && taxels > 0 && parts.clock->taxels() == taxels &&
         parts.crosstalk->taxels() == taxels && static_cast<std::size_t>(parts.bursts->taxels()) == taxels &&
         parts.hum->taxels() == taxels && parts.integration->taxels() == taxels && parts.history->taxels() == taxels &&
         size_of(parts.finder->grid()) == taxels && static_cast<std::size_t>(parts.channel->taxels()) == taxels;
}

}  // namespace

ScanPath::ScanPath(ScanParts parts, const InverseSignalChain& chain, std::vector<double> offset,
                   const InterpolationLimits& interpolation)
    : parts_(std::move(parts)),
      chain_(chain),
      offset_(std::move(offset)),
      any_offset_(std::any_of(offset_.begin(), offset_.end(), [](double each) { return each != 0.0; })),
      interpolation_(interpolation),
      counts_(offset_.size()),
      charge_(offset_.size()),
      saturated_(offset_.size()),
      filled_(offset_.size()),
      filled_deviation_(offset_.size()),
      unlisted_(offset_.size()),
      interpolated_(offset_.size()),
      unknown_(offset_.size()),
      variance_(offset_.size()),
      scan_variance_(offset_.size()) {
  if (!fit_together(parts_, offset_.size())) {
    throw std::invalid_argument("all parts must be of one array");
  }
  const ForceIntegration::State& state = parts_.integration->state();
  estimate_.force = state.force.data();
  estimate_.variance = variance_.data();
  estimate_.correlated_error = state.correlated_error.data();
  estimate_.causes = parts_.integration->causes();
  estimate_.held = state.held.data();
  estimate_.rise_deviation = &state.rise_deviation;
  scan_estimate_ = estimate_;
  scan_estimate_.variance = scan_variance_.data();
}

void ScanPath::set_hum(std::shared_ptr<HumFilter> hum) {
  if (!hum || hum->taxels() != taxels()) {
    throw std::invalid_argument("hum must be of the same array");
  }
  parts_.hum = std::move(hum);
}

void ScanPath::set_faulty(const bool* unlisted, const bool* interpolated) {
  any_unlisted_ = unlisted != nullptr;
  any_interpolated_ = false;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    unlisted_[taxel] = any_unlisted_ && unlisted[taxel];
    const bool now = any_unlisted_ && interpolated[taxel];
    if (now && !interpolated_[taxel]) {
      filled_[taxel] = filled_deviation_[taxel] = 0.0;  // until the next scan
    }
    interpolated_[taxel] = now;
    any_interpolated_ = any_interpolated_ || now;
  }
}

void ScanPath::set_variance(const double* variance) {
  std::copy(variance, variance + taxels(), variance_.begin());
  estimate_.forget();
}

bool ScanPath::receive(const Scan& scan) {
  begun_ = false;
  fits_ = parts_.clock->fits(scan);
  if (fits_ && !parts_.clock->is_new(scan)) {
    result_.accepted = result_.unusable = false;
    return false;
  }
  return true;
}

bool ScanPath::begin(const Scan& scan) {
  ScanClock& clock = *parts_.clock;
  const bool sound = fits_ && scan.taxels == taxels() && clock.is_sound(scan) && is_plausible(scan);
  const bool* faulty = parts_.integration->state().ignored.data();
  const bool burst = sound && parts_.bursts->is_burst(charge_.data(), scan.sequence, faulty);
  clock.counts().bursts += burst ? 1 : 0;
  result_.accepted = sound && !burst;
  result_.unusable = blank_ = !result_.accepted;
  if (result_.unusable) {
    clock.refuse(scan);
    flag(scan);
    return true;
  }
  clock.admit(scan);
  result_.stamp = scan.stamp;
  result_.sequence = scan.sequence;
  std::copy(scan.counts, scan.counts + taxels(), counts_.begin());
  if (any_offset_) {
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      charge_[taxel] -= offset_[taxel];
    }
  }
  if (parts_.crosstalk->present()) {
    parts_.crosstalk->apply(charge_.data());
  }
  ForceIntegration& integration = *parts_.integration;
  HumFilter& hum = *parts_.hum;
  if (clock.interrupted()) {
    integration.block().started = integration.block().valid = false;
    parts_.channel->pause();
    hum.clear();
    hum.start_window();
    estimate_.forget();
  }
  if (hum.state().sampling) {
    hum.remove(charge_.data(), clock.step());
  }
  begun_ = true;
  if (clock.step() > integration.limits().long_step) {
    estimate_.forget();
  }
  return integration.process(charge_.data(), scan.temperatures, scan.sensors, clock.step());
}

void ScanPath::finish() {
  if (!begun_) {
    return;
  }
  begun_ = false;
  const double step = parts_.clock->step();
  ForceIntegration& integration = *parts_.integration;
  ContactTracker& tracker = *parts_.tracker;
  DynamicChannel& channel = *parts_.channel;
  result_.saturated = counted_saturated();
  if (saturated_now_ > 0) {
    integration.clip(saturated_.data(), step);
  }
  integration.compensate_common_mode(!tracker.idle());
  parts_.history->add(counts_.data(), parts_.clock->close());
  const double* force = integration.state().force.data();
  const std::size_t regions = any_interpolated_ ? find_with_faulty() : parts_.finder->find(force);
  if (regions > 0 || vibration_wanted) {
    channel.advance(integration.state().change.data(), step);
    if (vibration_wanted) {
      channel.update_power(step);
    }
  } else {
    channel.pause();
  }
  shows_released_ = regions > 0 || !tracker.idle();
  if (shows_released_) {
    channel.update(tracker.follow(*parts_.finder, estimate(), step), force, step);
  }
  result_.valid = integration.block().valid && !parts_.clock->suspect() && !integration.state().ignored.all();
  result_.reasons = result_.valid ? 0 : reasons();
}

/// Find saturated taxels; refuse a scan in which most are saturated, unless it persists.
bool ScanPath::is_plausible(const Scan& scan) {
  saturated_now_ = chain_.read(scan.counts, taxels(), charge_.data(), saturated_.data());
  if (2 * saturated_now_ <= taxels()) {
    implausible_in_a_row_ = 0;
    return true;
  }
  if (implausible_in_a_row_ >= kMostImplausible) {
    return true;
  }
  ++implausible_in_a_row_;
  ++parts_.clock->counts().implausible;
  return false;
}

/// Number of saturated taxels that are not faulty.
std::size_t ScanPath::counted_saturated() const {
  std::size_t found = 0;
  for (std::size_t taxel = 0; taxel < taxels() && saturated_now_ > 0; ++taxel) {
    found += saturated_[taxel] && !parts_.integration->state().ignored[taxel] ? 1 : 0;
  }
  return found;
}

/// Set the result of an unusable scan: the contacts stay as they were, and nothing is valid.
void ScanPath::flag(const Scan& scan) {
  result_.stamp = scan.stamp;
  result_.sequence = scan.sequence;
  result_.valid = false;
  result_.reasons = kScanUnusable;
  shows_released_ = false;
}

/// Find the regions in contact, with the forces of faulty taxels interpolated from their neighbours.
std::size_t ScanPath::find_with_faulty() {
  const ForceIntegration::State& state = parts_.integration->state();
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    filled_[taxel] = interpolated_[taxel] ? 0.0 : state.force[taxel];
    filled_deviation_[taxel] = 0.0;
  }
  if (!parts_.finder->thresholds().any(filled_.data())) {
    return parts_.finder->find(filled_.data());
  }
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    unknown_[taxel] = interpolated_[taxel] || !state.offset_known[taxel];
  }
  // Those that are interpolated are unknown, and so no value of one depends on another.
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    if (interpolated_[taxel]) {
      const NeighbourEstimate found = neighbour_interpolation(parts_.finder->grid(), filled_.data(), unknown_.data(),
                                                              static_cast<Taxel>(taxel), interpolation_);
      filled_[taxel] = found.force;
      filled_deviation_[taxel] = found.deviation;
    }
  }
  return parts_.finder->find(filled_.data());
}

/// The forces with their uncertainty at the end of the last block.
const ForceEstimate& ScanPath::estimate() {
  if (!any_interpolated_ && saturated_now_ == 0) {
    estimate_.unlisted = any_unlisted_ ? unlisted_.data() : nullptr;
    return estimate_;
  }
  scan_estimate_.forget();
  scan_estimate_.force = any_interpolated_ ? filled_.data() : estimate_.force;
  scan_estimate_.unlisted = any_unlisted_ ? unlisted_.data() : nullptr;
  scan_estimate_.interpolated = any_interpolated_ ? interpolated_.data() : nullptr;
  scan_estimate_.saturated = saturated_now_ > 0 ? saturated_.data() : nullptr;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    scan_variance_[taxel] = interpolated_[taxel] ? square(filled_deviation_[taxel]) : variance_[taxel];
  }
  return scan_estimate_;
}

/// Why the result of an accepted scan is not valid.
std::uint8_t ScanPath::reasons() const {
  std::uint8_t found = parts_.clock->suspect() ? kTimeUncertain : 0;
  if (!parts_.integration->block().valid) {
    found |= parts_.integration->state().knows_offsets() ? kUncertain : kBaselineUnknown;
  }
  return found == 0 ? kNoTaxel : found;
}

}  // namespace posfet
