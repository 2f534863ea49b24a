// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/assignment.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>

namespace posfet {

namespace {

constexpr std::size_t kNobody = std::numeric_limits<std::size_t>::max();

/// Rows that were added so far, with the dual prices under which they are assigned at least cost.
class Assignment {
public:
  Assignment(const Vector<Vector<double>>& costs, double unassigned_cost)
      : costs_(costs),
        unassigned_cost_(unassigned_cost),
        given_(costs.front().size()),
        row_prices_(costs.size(), 0.0),
        prices_(given_ + costs.size(), 0.0),
        owner_(given_ + costs.size(), kNobody) {}

  /// Add a row along the shortest augmenting path.
  void add(std::size_t added) {
    const std::size_t columns = owner_.size();
    Vector<double> least(columns, std::numeric_limits<double>::infinity());
    Vector<std::size_t> before(columns, kNobody);
    Vector<std::size_t> reached;
    Vector<std::size_t> left(columns);
    for (std::size_t column = 0; column < columns; ++column) {
      left[column] = column;
    }
    std::size_t column = kNobody;
    for (std::size_t row = added; row != kNobody; row = owner_[column]) {
      for (const std::size_t other : left) {
        const double reduced = cost(row, other) - row_prices_[row] - prices_[other];
        if (reduced < least[other]) {
          least[other] = reduced;
          before[other] = column;
        }
      }
      const auto nearest = std::min_element(
          left.begin(), left.end(), [&](std::size_t one, std::size_t other) { return least[one] < least[other]; });
      column = *nearest;
      left.erase(nearest);
      reprice(added, least[column], reached, left, least);
      reached.push_back(column);
    }
    for (; column != kNobody; column = before[column]) {
      owner_[column] = before[column] != kNobody ? owner_[before[column]] : added;
    }
  }

  Vector<Pair> pairs() const {
    Vector<Pair> found;
    for (std::size_t column = 0; column < given_; ++column) {
      if (owner_[column] != kNobody) {
        found.emplace_back(static_cast<int>(owner_[column]), static_cast<int>(column));
      }
    }
    std::sort(found.begin(), found.end());
    return found;
  }

private:
  /// Cost of a row with a column; those behind the given ones represent no assignment.
  double cost(std::size_t row, std::size_t column) const {
    return column < given_ ? costs_[row][column] : unassigned_cost_;
  }

  void reprice(std::size_t added, double step, const Vector<std::size_t>& reached, const Vector<std::size_t>& left,
               Vector<double>& least) {
    row_prices_[added] += step;
    for (const std::size_t column : reached) {
      row_prices_[owner_[column]] += step;
      prices_[column] -= step;
    }
    for (const std::size_t column : left) {
      least[column] -= step;
    }
  }

  const Vector<Vector<double>>& costs_;
  double unassigned_cost_;
  std::size_t given_;
  Vector<double> row_prices_;
  Vector<double> prices_;
  Vector<std::size_t> owner_;
};

}  // namespace

Vector<Pair> minimum_cost_assignment(const Vector<Vector<double>>& costs, double unassigned_cost) {
  if (costs.empty()) {
    return {};
  }
  Assignment assignment(costs, unassigned_cost);
  for (std::size_t row = 0; row < costs.size(); ++row) {
    assignment.add(row);
  }
  return assignment.pairs();
}

}  // namespace posfet
