// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Counts of the ADC back to charge, and where the signal may have been clipped.
///
/// The same operations as in posfet_model/sensor/signal_chain.py, so that charges are the same to the last bit.
#pragma once

#include <cstddef>
#include <cstdint>

namespace posfet {

/// Charge density of each count, and the counts from which the voltage is so close to an end of the range that it may
/// have been clipped.
struct InverseSignalChain {
  double zero;         ///< Voltage of count 0 [V].
  double per_count;    ///< Voltage of one count [V].
  double gain;         ///< Gain of the follower [1].
  double offset;       ///< Offset of the amplifier [V].
  double capacitance;  ///< Capacitance of the film per area [F/m2].
  int low;             ///< Counts up to this one are saturated; -1: none.
  int high;            ///< Counts from this one on are saturated; 65536: none.

  /// Read the charge densities [C/m2] and saturation of `taxels` counts; returns the number of saturated ones.
  std::size_t read(const std::uint16_t* counts, std::size_t taxels, double* charge, bool* saturated) const {
    std::size_t found = 0;
    for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
      const double volts = zero + static_cast<double>(counts[taxel]) * per_count;
      charge[taxel] = (volts / gain - offset) * capacitance;
      saturated[taxel] = counts[taxel] <= low || counts[taxel] >= high;
      found += saturated[taxel] ? 1 : 0;
    }
    return found;
  }
};

}  // namespace posfet
