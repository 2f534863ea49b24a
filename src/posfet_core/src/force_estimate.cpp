// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/force_estimate.hpp"

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Number of sums that are kept at most.
constexpr std::size_t kMostSums = 64;

}  // namespace

double ForceEstimate::variance_of_sum(const Taxels& taxels) const {
  const auto known = sums_.find(taxels);
  if (known != sums_.end()) {
    return known->second;
  }
  if (sums_.size() >= kMostSums) {
    sums_.clear();
  }
  return sums_.emplace(taxels, computed_variance_of_sum(taxels)).first->second;
}

double ForceEstimate::variance_of_rise(const Taxels& taxels) const {
  if (held == nullptr) {
    return 0.0;
  }
  double risen = 0.0;
  for (const Taxel taxel : taxels) {
    risen += is_measured(taxel) ? force[taxel] - held[taxel] : 0.0;
  }
  return square(*rise_deviation * risen);
}

double ForceEstimate::computed_variance_of_sum(const Taxels& taxels) const {
  double total = 0.0;
  for (const Taxel taxel : taxels) {
    total += variance[taxel];
  }
  for (std::size_t cause = 0; cause < causes; ++cause) {
    double shared = 0.0;
    for (const Taxel taxel : taxels) {
      shared += is_measured(taxel) ? correlated_error[static_cast<std::size_t>(taxel) * causes + cause] : 0.0;
    }
    total += shared * shared;
  }
  return total;
}

}  // namespace posfet
