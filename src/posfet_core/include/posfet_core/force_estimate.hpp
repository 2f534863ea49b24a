// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Forces of all taxels with their uncertainty.
#pragma once

#include <cstddef>

#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Forces of one array and what is known of their errors. The arrays belong to the caller, have one value for each
/// taxel, and outlive this object. Forces may be overwritten from scan to scan, the other values only
/// before `forget`.
class ForceEstimate {
public:
  const double* force = nullptr;     ///< [N], positive when pushed.
  const double* variance = nullptr;  ///< Variance of each force that it does not share with others [N2].
  const bool* saturated = nullptr;   ///< Taxels whose force is a lower bound; null: none.
  const bool* unlisted = nullptr;    ///< Taxels that count toward force and moments, but are in no list; null: none.
  /// Those among them whose force is interpolated from their neighbours, and that are no region by themselves.
  const bool* interpolated = nullptr;
  /// Factor E of the covariance E E' that the forces have in common [N], of shape [taxels, causes], row by row.
  const double* correlated_error = nullptr;
  std::size_t causes = 0;
  const double* held = nullptr;            ///< Force that these errors are about [N]; null: all of it.
  const double* rise_deviation = nullptr;  ///< Relative standard deviation of what a force has changed by since [1].

  /// Variance of the sum of the forces of some taxels [N2]; kept until `forget`, as regions repeat.
  double variance_of_sum(const Taxels& taxels) const;

  /// Variance of what the forces of some taxels have changed by since the last block [N2].
  double variance_of_rise(const Taxels& taxels) const;

  /// Compute the variances again: variances or correlated errors have changed.
  void forget() { sums_.clear(); }

private:
  double computed_variance_of_sum(const Taxels& taxels) const;

  /// Whether a force is a taxel's own: errors of a reading that is not used count for nothing.
  bool is_measured(Taxel taxel) const { return interpolated == nullptr || !interpolated[taxel]; }

  mutable Map<Taxels, double> sums_;
};

}  // namespace posfet
