// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Regions of an array in contact, with the ring of taxels around each.
#pragma once

#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// 8-connected components of a mask, in the order of their first taxels.
Vector<Taxels> connected_components(const Grid& grid, const Mask& mask);

/// A region in contact with the ring of taxels around it, without taxels that belong to two rings.
struct Footprint {
  Taxels region;         ///< Taxels in contact.
  Taxels members;        ///< Region and ring: the taxels that count toward force and moments.
  bool at_edge = false;  ///< Whether a member lies in the outermost rows or columns.
};

/// Footprints of the connected components of a mask, in their order.
Vector<Footprint> footprints(const Grid& grid, const Mask& mask);

/// Taxels that a contact lists.
struct Outline {
  Taxels taxels;
  Point centre;  ///< Their mean position [m].
  double area;   ///< Area of their cells [m2].
};

/// Outline of at least one taxel.
Outline outline(const Grid& grid, Taxels taxels);

}  // namespace posfet
