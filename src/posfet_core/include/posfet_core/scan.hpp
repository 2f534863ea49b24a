// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// One scan as a board sends it.
#pragma once

#include <cstddef>
#include <cstdint>

namespace posfet {

/// Bits of the status of a scan that matter here; the values are those of STATUS_* in posfet_msgs/TactileRaw.
constexpr std::uint32_t kAdcFault = 2;
constexpr std::uint32_t kBoardReset = 16;
constexpr std::uint32_t kTimeEstimated = 32;
constexpr std::uint32_t kChargeReset = 128;

/// One complete scan. The arrays belong to the caller, and are not kept.
struct Scan {
  std::int64_t stamp = 0;                 ///< Acquisition time [ns] since the Unix epoch.
  std::uint64_t layout = 0;               ///< Identifier of the layout.
  std::uint64_t sequence = 0;             ///< Sequence number since the board started, unwrapped.
  std::int64_t device_time = 0;           ///< Clock of the board at acquisition [us], unwrapped.
  std::uint32_t status = 0;               ///< Bits of the status.
  const std::uint16_t* counts = nullptr;  ///< ADC codes on a 16-bit scale, row by row.
  std::size_t taxels = 0;                 ///< Number of counts.
  const float* temperatures = nullptr;    ///< Readings of the chip's temperature sensors [degC]; NaN: unknown.
  std::size_t sensors = 0;                ///< Number of these readings.
};

}  // namespace posfet
