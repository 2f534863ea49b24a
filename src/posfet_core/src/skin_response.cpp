// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/skin_response.hpp"

#include <array>
#include <cmath>

namespace posfet {

namespace {

/// The two neighbours of a taxel along an axis, as places in `Grid::kOffsets`.
using Places = std::array<std::size_t, 2>;
constexpr Places kAlongX{3, 4};
constexpr Places kAlongY{1, 6};

/// What the neighbours of a taxel along an axis feel together.
struct Felt {
  double force = 0.0;
  double variance = 0.0;
  int known = 0;
  bool all_known = true;
};

Felt felt_along(const Places& places, const std::array<Taxel, 8>& around, const double* force, const double* variance,
                const bool* sound) {
  Felt felt;
  for (const std::size_t place : places) {
    const Taxel other = around[place];
    if (other == Grid::kOutside) {
      continue;
    }
    if (!sound[other]) {
      felt.all_known = false;
      continue;
    }
    felt.force += force[other];
    felt.variance += variance[other];
    ++felt.known;
  }
  return felt;
}

}  // namespace

SkinResponse::SkinResponse(const Layout& layout, double share_x, double share_y)
    : grid_(layout), share_x_(share_x), share_y_(share_y) {}

SkinResponse::Finding SkinResponse::test(Taxel taxel, const double* force, const double* variance, const bool* sound,
                                         double certainty, bool one_sided) const {
  Finding found;
  const double sign = force[taxel] < 0.0 ? -1.0 : 1.0;
  const auto test_along = [&](const Places& places, double share) {
    const Felt felt = felt_along(places, grid_.neighbours(taxel), force, variance, sound);
    if (std::isnan(share) || !felt.all_known || felt.known < (one_sided ? 1 : 2)) {
      return;
    }
    found.testable = true;
    const double part = share * static_cast<double>(felt.known);
    const double missing = part * std::abs(force[taxel]) - sign * felt.force;
    const double deviation = std::sqrt(felt.variance + part * part * variance[taxel]);
    // Without a force there is nothing that they must feel.
    const bool little = force[taxel] != 0.0 && sign * felt.force < kClearShare * part * std::abs(force[taxel]);
    found.contradicted = found.contradicted || (little && missing > certainty * deviation);
  };
  test_along(kAlongX, share_x_);
  test_along(kAlongY, share_y_);
  return found;
}

}  // namespace posfet
