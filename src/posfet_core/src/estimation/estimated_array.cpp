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

EstimatedArray completed(EstimatedArray array) {
  const Grid grid(array.layout);
  const auto taxels = static_cast<std::size_t>(grid.taxels());
  for (const auto* values : {&array.time_constant, &array.newton_per_charge, &array.newton_per_kelvin,
                             &array.gain_deviation, &array.leak_deviation}) {
    if (values->size() != taxels) {
      throw std::invalid_argument("all values must be given for each taxel");
    }
  }
  std::vector<double>& profile = array.priors.bend_profile;
  if (profile.empty()) {
    profile.assign(taxels, 1.0);
  }
  if (profile.size() != taxels) {
    throw std::invalid_argument("bend_profile must have one value for each taxel, or none");
  }
  for (double& response : array.newton_per_kelvin) {
    const double greatest = static_cast<double>(taxels) * kHottest * std::abs(response);
    response = greatest < array.threshold ? 0.0 : response;
  }
  array.per_kelvin = sum(array.newton_per_kelvin) / static_cast<double>(taxels);
  for (Taxel taxel = 0; taxel < grid.taxels(); ++taxel) {
    array.x.push_back(place_of(grid.col(taxel), array.layout.cols));
    array.y.push_back(place_of(grid.row(taxel), array.layout.rows));
  }
  return array;
}

}  // namespace posfet
