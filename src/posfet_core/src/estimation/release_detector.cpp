// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/release_detector.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "force_estimator_constants.hpp"

namespace posfet {

namespace {

/// Mean of so many squares that zero forces exceed as rarely as `kReleasedDeviations`. Quantile of the chi-square
/// distribution after Wilson and Hilferty, PNAS 17, 684, 1931.
double mean_square(std::size_t count) {
  const double spread = 2.0 / (9.0 * static_cast<double>(count));
  return std::pow(1.0 - spread + ReleaseDetector::kReleasedDeviations * std::sqrt(spread), 3.0);
}

}  // namespace

ReleaseDetector::ReleaseDetector(std::size_t taxels)
    : peak_(taxels, 0.0),
      object_(taxels, 0.0),
      means_(kStillBlocks + 1, std::vector<double>(taxels, 0.0)),
      touched_for_(taxels, 0),
      looks_released_for_(taxels, kReleasedBlocks) {}

bool ReleaseDetector::update(const Vector<const Taxels*>& contacts, const double* mean, const double* course,
                             const double* rise, const bool* touched, const double* variance, const double* noise,
                             double duration, bool* released) {
  const std::size_t taxels = peak_.size();
  const double kept = std::pow(kPeakDecay, duration / kBlock);
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    peak_[taxel] = std::max(kept * peak_[taxel], touched[taxel] ? mean[taxel] : 0.0);
    object_[taxel] *= kept;
    touched_for_[taxel] = touched[taxel] ? touched_for_[taxel] + 1 : 0;
  }
  means_[seen_ % means_.size()].assign(course, course + taxels);
  ++seen_;
  for (const Taxels* contact : contacts) {
    follow(*contact, mean, rise);
  }
  const auto looks = [&](const Taxels& contact) { return looks_released(contact, mean, course, variance, noise); };
  return looks_released_for_.update(contacts, looks, released);
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
                                     const double* variance, const double* noise) const {
  if (seen_ < means_.size() || contact.empty()) {
    return false;
  }
  const std::vector<double>& before = means_[seen_ % means_.size()];
  double peak = 0.0;
  double object = 0.0;
  double total = 0.0;
  double motion = -std::numeric_limits<double>::infinity();  // beyond the noise of each taxel [N]
  double squares = 0.0;
  for (const Taxel each : contact) {
    const auto taxel = static_cast<std::size_t>(each);
    peak = std::max(peak, peak_[taxel]);
    object = std::max(object, object_[taxel]);
    total += mean[taxel];
    motion = std::max(motion, std::abs(course[taxel] - before[taxel]) - kGate * std::sqrt(noise[taxel]));
    squares += mean[taxel] * mean[taxel] / variance[taxel];
  }
  return total < kReleasedShare * object && motion < kResidualMotion * peak &&
         squares / static_cast<double>(contact.size()) < mean_square(contact.size());
}

}  // namespace posfet
