// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/known_forces.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "posfet_core/medians.hpp"

namespace posfet {

namespace {

/// Mean residual from which on residuals are no error that the filter expects [1]: as many deviations of that mean.
const double kPersistent = kGate / std::sqrt(2.0 * UnexplainedResiduals::kPersistentBlocks - 1.0);

/// Mean of so many squares that zero forces exceed as rarely as `kReleasedDeviations`. Quantile of the chi-square
/// distribution after Wilson and Hilferty, PNAS 17, 684, 1931.
double mean_square(std::size_t count) {
  const double spread = 2.0 / (9.0 * static_cast<double>(count));
  return std::pow(1.0 - spread + ReleaseDetector::kReleasedDeviations * std::sqrt(spread), 3.0);
}

}  // namespace

UnexplainedResiduals::UnexplainedResiduals(std::size_t taxels, double threshold)
    : small_(kSmall * threshold),
      rising_(taxels),
      below_(taxels, 0.0),
      steady_(taxels, 0.0),
      level_(taxels, 0.0),
      mean_(taxels, 0.0) {}

void UnexplainedResiduals::add_persistent(const bool* where, const double* residual, bool* odd) {
  for (std::size_t taxel = 0; taxel < mean_.size(); ++taxel) {
    mean_[taxel] = where[taxel] ? mean_[taxel] + (residual[taxel] - mean_[taxel]) / kPersistentBlocks : 0.0;
    odd[taxel] = odd[taxel] || mean_[taxel] > kPersistent;
  }
}

void UnexplainedResiduals::update(const bool* odd, const double* residual, const double* mean, const double* noise,
                                  double duration, bool* errors) {
  std::fill(errors, errors + below_.size(), false);
  if (std::none_of(odd, odd + below_.size(), [](bool each) { return each; })) {
    reset();
    return;
  }
  for (std::size_t taxel = 0; taxel < below_.size(); ++taxel) {
    const bool up = residual[taxel] > 0.0;
    rising_[taxel] = odd[taxel] && up;
    below_[taxel] = odd[taxel] && !up ? below_[taxel] + duration : 0.0;
    const bool moved = !rising_[taxel] || std::abs(mean[taxel] - level_[taxel]) > kSteadyDeviations * noise[taxel];
    level_[taxel] = moved ? mean[taxel] : level_[taxel];
    steady_[taxel] = moved ? 0.0 : steady_[taxel] + duration;
    errors[taxel] = below_[taxel] >= kNegativeTime || (steady_[taxel] >= kUnexplainedTime && residual[taxel] < small_);
    if (errors[taxel]) {
      below_[taxel] = steady_[taxel] = 0.0;
    }
  }
}

void UnexplainedResiduals::reset() {
  rising_.fill(false);
  std::fill(below_.begin(), below_.end(), 0.0);
  std::fill(steady_.begin(), steady_.end(), 0.0);
}

ReleaseDetector::ReleaseDetector(std::size_t taxels)
    : peak_(taxels, 0.0),
      object_(taxels, 0.0),
      means_(kStillBlocks + 1, std::vector<double>(taxels, 0.0)),
      touched_for_(taxels, 0),
      blocks_(taxels, 0) {}

bool ReleaseDetector::update(const Vector<const Taxels*>& contacts, const double* mean, const double* course,
                             const double* rise, const bool* touched, const double* variance, double noise,
                             bool* released) {
  const std::size_t taxels = peak_.size();
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    peak_[taxel] = std::max(kPeakDecay * peak_[taxel], touched[taxel] ? mean[taxel] : 0.0);
    object_[taxel] *= kPeakDecay;
    touched_for_[taxel] = touched[taxel] ? touched_for_[taxel] + 1 : 0;
  }
  means_[seen_ % means_.size()].assign(course, course + taxels);
  ++seen_;
  for (const Taxels* contact : contacts) {
    follow(*contact, mean, rise);
  }
  std::fill(released, released + taxels, false);
  for (const Taxels* contact : contacts) {
    const bool looks = looks_released(*contact, mean, course, variance, noise);
    for (const Taxel taxel : *contact) {
      released[static_cast<std::size_t>(taxel)] = looks;
    }
  }
  bool any = false;
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    blocks_[taxel] = released[taxel] ? blocks_[taxel] + 1 : 0;
    released[taxel] = blocks_[taxel] >= kReleasedBlocks;
    any = any || released[taxel];
  }
  return any;
}

/// Follow the peaks of a contact. It is one object: what is left at its edge was its, too. What an earlier one has left
/// there is not.
void ReleaseDetector::follow(const Taxels& contact, const double* mean, const double* rise) {
  double total = 0.0;
  std::size_t strongest = contact.empty() ? 0 : static_cast<std::size_t>(contact.front());
  for (const Taxel each : contact) {
    const auto taxel = static_cast<std::size_t>(each);
    total += mean[taxel];
    strongest = mean[taxel] > mean[strongest] ? taxel : strongest;
  }
  const bool came = total < kReleasedShare * object_[strongest] && has_just_come(contact, total, rise);
  const double peak = came ? mean[strongest] : peak_[strongest];
  const double object = came ? total : std::max(object_[strongest], total);
  for (const Taxel taxel : contact) {
    peak_[static_cast<std::size_t>(taxel)] = peak;
    object_[static_cast<std::size_t>(taxel)] = object;
  }
}

bool ReleaseDetector::has_just_come(const Taxels& contact, double total, const double* rise) const {
  double risen = 0.0;
  bool rested = true;
  for (const Taxel each : contact) {
    const auto taxel = static_cast<std::size_t>(each);
    risen += rise[taxel];
    rested = rested && touched_for_[taxel] <= kStillBlocks;
  }
  return rested && risen > kRisenShare * total;
}

bool ReleaseDetector::has_left(std::size_t taxel, double mean, double noise) const {
  if (seen_ < means_.size()) {
    return true;
  }
  const auto& before = means_[(seen_ - 1 - kReleasedBlocks) % means_.size()];
  const double moved = std::abs(means_[(seen_ - 1) % means_.size()][taxel] - before[taxel]);
  return mean < -kGate * noise || moved < kGate * noise + kResidualMotion * peak_[taxel];
}

bool ReleaseDetector::looks_released(const Taxels& contact, const double* mean, const double* course,
                                     const double* variance, double noise) const {
  if (seen_ < means_.size() || contact.empty()) {
    return false;
  }
  const std::vector<double>& before = means_[seen_ % means_.size()];
  double peak = 0.0;
  double object = 0.0;
  double total = 0.0;
  double moved = 0.0;
  double squares = 0.0;
  for (const Taxel each : contact) {
    const auto taxel = static_cast<std::size_t>(each);
    peak = std::max(peak, peak_[taxel]);
    object = std::max(object, object_[taxel]);
    total += mean[taxel];
    moved = std::max(moved, std::abs(course[taxel] - before[taxel]));
    squares += mean[taxel] * mean[taxel] / variance[taxel];
  }
  return total < kReleasedShare * object && moved < kGate * noise + kResidualMotion * peak &&
         squares / static_cast<double>(contact.size()) < mean_square(contact.size());
}

UniformChange::UniformChange(std::vector<double> newton_per_kelvin, double spread)
    : per_kelvin_(std::move(newton_per_kelvin)),
      spread_(spread),
      observable_(per_kelvin_.size() >= kFewestForUniform &&
                  std::all_of(per_kelvin_.begin(), per_kelvin_.end(), [](double each) { return each != 0.0; })) {
  work_.reserve(per_kelvin_.size());
}

double UniformChange::median_of(const double* values, const bool* where) {
  work_.clear();
  for (std::size_t taxel = 0; taxel < per_kelvin_.size(); ++taxel) {
    if (where[taxel]) {
      work_.push_back(values[taxel]);
    }
  }
  return median(work_);
}

double UniformChange::temperature(const double* residual, const bool* where, const double* deviation, const double* own,
                                  double duration, bool noticed) {
  work_.clear();
  double response = 0.0;
  for (std::size_t taxel = 0; taxel < per_kelvin_.size(); ++taxel) {
    if (where[taxel]) {
      work_.push_back(residual[taxel] / per_kelvin_[taxel]);
      response += per_kelvin_[taxel];
    }
  }
  if (!observable_ || work_.size() < kFewestForUniform) {
    return 0.0;
  }
  const auto count = static_cast<double>(work_.size());
  const double kelvin = median(work_);
  const double force = kelvin * response / count;  // mean of the taxels
  const double single = median_of(deviation, where);
  const double alone = median_of(own, where);
  const double shared = std::max(single * single - alone * alone, 0.0);
  const double least = (noticed ? kNoticeable : kGate) * std::sqrt(shared + alone * alone / count);
  if (std::abs(force) < least) {
    return 0.0;
  }
  if (force < 0.0) {
    return kelvin;  // no object pulls at the whole array
  }
  int misfits = 0;
  for (std::size_t taxel = 0; taxel < per_kelvin_.size(); ++taxel) {
    const double expected = kelvin * per_kelvin_[taxel];
    const double tolerance = kNoticeable * (spread_ * std::abs(expected) + own[taxel]);
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
