// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/lone_drift.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/block.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

LoneDrift::LoneDrift(std::size_t taxels)
    : means_(kBlocks, std::vector<double>(taxels, 0.0)),
      times_(kBlocks, 0.0),
      listed_for_(taxels, 0),
      since_(taxels, 0.0),
      rate_(taxels, 0.0),
      held_(taxels) {}

std::optional<LoneDrift::Drift> LoneDrift::observe(const double* mean, const bool* counts, const bool* listed,
                                                   const bool* touched, double variance, double duration) {
  remember(mean, listed, touched, duration);
  const bool any = std::any_of(listed, listed + taxels(), [](bool each) { return each; });
  if (!any || seen_ < kBlocks || seen_ % kHop != 0) {
    return std::nullopt;
  }
  const Window now = window(counts, variance);
  if (std::max(std::abs(now.own), now.others) < kGate * now.noise) {
    for (double& each : since_) {
      each = std::min(each, now.duration);
    }
  }
  const bool drifts = std::abs(now.own) > kGate * now.noise && now.others < kOthers * std::abs(now.own);
  const bool same = windows_ > 0 && now.taxel == taxel_ && std::abs(now.own - first_) < kSame * std::abs(first_);
  if (!drifts || !same) {
    windows_ = drifts ? 1 : 0;
    taxel_ = now.taxel;
    first_ = sum_ = now.own;
    return std::nullopt;
  }
  sum_ += now.own;
  if (++windows_ < kWindows) {
    return std::nullopt;
  }
  const Drift found{taxel_, sum_ / static_cast<double>(windows_), std::max(since_[taxel_], now.duration), now.duration};
  windows_ = 0;
  since_[taxel_] = 0.0;  // from now on it is known
  return found;
}

void LoneDrift::remember(const double* mean, const bool* listed, const bool* touched, double duration) {
  const double last = times_[(seen_ + kBlocks - 1) % kBlocks];
  times_[seen_ % kBlocks] = last + duration;
  std::copy_n(mean, taxels(), means_[seen_ % kBlocks].begin());
  ++seen_;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    listed_for_[taxel] = listed[taxel] ? listed_for_[taxel] + 1 : 0;
    since_[taxel] = touched[taxel] ? since_[taxel] + duration : 0.0;
  }
}

/// Find the rates of the forces in the last blocks; returns the sum of the squares of the times about their mean [s2].
double LoneDrift::find_rates() {
  const double middle = sum(times_) / static_cast<double>(kBlocks);
  double squares = 0.0;
  std::fill(rate_.begin(), rate_.end(), 0.0);
  for (std::size_t block = 0; block < kBlocks; ++block) {
    const double time = times_[block] - middle;
    squares += square(time);
    for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
      rate_[taxel] += time * means_[block][taxel];
    }
  }
  for (double& each : rate_) {
    each /= squares;
  }
  return squares;
}

/// Take from the rates of the held taxels what they have in common in proportion to their forces, as those but one
/// show it.
void LoneDrift::take_common(std::size_t but) {
  const std::vector<double>& force = means_[(seen_ - 1) % kBlocks];
  double product = 0.0;
  double squares = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    const double counted = held_[taxel] && taxel != but ? force[taxel] : 0.0;
    product += rate_[taxel] * counted;
    squares += square(counted);
  }
  const double common = squares > 0.0 ? product / squares : 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    rate_[taxel] -= held_[taxel] ? common * force[taxel] : 0.0;
  }
}

/// Find what the last blocks show.
LoneDrift::Window LoneDrift::window(const bool* counts, double variance) {
  const double noise = std::sqrt(variance / find_rates());
  std::size_t fastest = 0;
  double greatest = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    held_[taxel] = counts[taxel] && listed_for_[taxel] >= kBlocks;
    if (held_[taxel] && std::abs(rate_[taxel]) > greatest) {
      fastest = taxel;
      greatest = std::abs(rate_[taxel]);
    }
  }
  take_common(fastest);
  double others = 0.0;
  for (std::size_t taxel = 0; taxel < taxels(); ++taxel) {
    others = counts[taxel] && taxel != fastest ? std::max(others, std::abs(rate_[taxel])) : others;
  }
  const double duration = times_[(seen_ - 1) % kBlocks] - times_[seen_ % kBlocks];
  return {fastest, held_[fastest] ? rate_[fastest] : 0.0, others, noise, duration};
}

}  // namespace posfet
