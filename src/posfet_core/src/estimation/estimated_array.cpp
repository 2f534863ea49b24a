// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/estimated_array.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "force_estimator_constants.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Position of a row or column among some, from -1 to 1 at the edges.
double place_of(Taxel index, Taxel count) {
  const double half = 0.5 * static_cast<double>(count - 1);
  return (static_cast<double>(index) - half) / std::max(half, 0.5);
}

}  // namespace

EstimatedArray::EstimatedArray(GivenArray given) : GivenArray(std::move(given)) {
  const Grid grid(layout);
  const auto count = static_cast<std::size_t>(grid.taxels());
  for (const auto* values :
       {&time_constant, &newton_per_charge, &newton_per_kelvin, &gain_deviation, &leak_deviation}) {
    if (values->size() != count) {
      throw std::invalid_argument("all values must be given for each taxel");
    }
  }
  std::vector<double>& profile = priors.bend_profile;
  if (profile.empty()) {
    profile.assign(count, 1.0);
  }
  if (profile.size() != count) {
    throw std::invalid_argument("bend_profile must have one value for each taxel, or none");
  }
  for (double& response : newton_per_kelvin) {
    const double greatest = static_cast<double>(count) * kHottest * std::abs(response);
    response = greatest < threshold ? 0.0 : response;
  }
  per_kelvin = sum(newton_per_kelvin) / static_cast<double>(count);
  for (Taxel taxel = 0; taxel < grid.taxels(); ++taxel) {
    x.push_back(place_of(grid.col(taxel), layout.cols));
    y.push_back(place_of(grid.row(taxel), layout.rows));
  }
}

}  // namespace posfet
