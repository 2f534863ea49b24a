// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/contact_surroundings.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Places in `Grid::kOffsets` of the neighbours at a corner.
constexpr std::array<std::size_t, 4> kCorners{0, 2, 5, 7};

/// Greatest force at some places around a taxel [N]; 0 outside of the array.
double greatest_at(const std::array<Taxel, 8>& around, const std::array<std::size_t, 4>& places,
                   const std::vector<double>& force) {
  double greatest = 0.0;
  for (const std::size_t place : places) {
    if (around[place] != Grid::kOutside) {
      greatest = std::max(greatest, force[static_cast<std::size_t>(around[place])]);
    }
  }
  return greatest;
}

/// Force of a taxel [N]; another one where it is unknown or outside of the array.
double known_force(const std::vector<double>& force, Taxel taxel, double other) {
  const double known = taxel == Grid::kOutside ? kUnknown : force[static_cast<std::size_t>(taxel)];
  return std::isnan(known) ? other : known;
}

}  // namespace

void ContactSurroundings::dilate(const TaxelFlags& mask, TaxelFlags& dilated) const {
  dilated.set(mask.data());
  for (Taxel taxel = 0; taxel < grid_.taxels(); ++taxel) {
    if (mask[static_cast<std::size_t>(taxel)]) {
      for (const Taxel other : grid_.neighbours(taxel)) {
        if (other != Grid::kOutside) {
          dilated[static_cast<std::size_t>(other)] = true;
        }
      }
    }
  }
}

void ContactSurroundings::complete(std::vector<double>& force, double least) const {
  if (std::none_of(force.begin(), force.end(), [](double each) { return std::isnan(each); })) {
    return;
  }
  std::vector<double> decline(force.size());
  geometric_decline(force, least, decline);
  std::transform(force.begin(), force.end(), decline.begin(), force.begin(),
                 [](double known, double other) { return std::isnan(known) ? other : known; });
}

void ContactSurroundings::greatest_neighbour(const std::vector<double>& force, std::vector<double>& greatest) const {
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    const auto& around = grid_.neighbours(static_cast<Taxel>(taxel));
    greatest[taxel] =
        std::max(greatest_at(around, Grid::kEdges, force), kDiagonal * greatest_at(around, kCorners, force));
  }
}

void ContactSurroundings::geometric_decline(const std::vector<double>& force, double least,
                                            std::vector<double>& decline) const {
  double greatest = least;
  for (const double each : force) {
    greatest = each > greatest ? each : greatest;  // unknown ones are not
  }
  for (std::size_t taxel = 0; taxel < force.size(); ++taxel) {
    decline[taxel] = 0.0;
    for (const std::size_t side : Grid::kEdges) {
      const Taxel beside = grid_.neighbours(static_cast<Taxel>(taxel))[side];
      const double first = known_force(force, beside, 0.0);
      if (first > 0.0) {
        const double second = known_force(force, grid_.neighbours(beside)[side], greatest);
        decline[taxel] = std::max(decline[taxel], first * first / std::max(first, second));
      }
    }
  }
}

}  // namespace posfet
