// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Linear assignment for the data association of contacts.
#pragma once

#include <utility>

#include "posfet_core/recycled.hpp"

namespace posfet {

/// A row and the column that is assigned to it.
using Pair = std::pair<int, int>;

/// Assignment of rows to columns with the least total cost, ascending by row.
///
/// Rows are added one at a time along the shortest augmenting path (Hungarian method with dual prices); the result is
/// optimal for any size. J. Munkres, J. SIAM 5, 32, 1957.
///
/// `costs` are those of each row with each column, >= 0, in any unit; all rows are of one length. `unassigned_cost` is
/// the cost of a row without a column; a column without a row costs nothing.
Vector<Pair> minimum_cost_assignment(const Vector<Vector<double>>& costs, double unassigned_cost);

}  // namespace posfet
