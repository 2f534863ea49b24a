// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// CAN frames.
#pragma once

#include <cstddef>
#include <cstdint>

namespace posfet::protocol {

/// Kind of a frame: a sum of these.
constexpr unsigned kClassic = 0;   ///< A data frame with an 11-bit identifier and up to 8 bytes.
constexpr unsigned kExtended = 1;  ///< The identifier has 29 bits.
constexpr unsigned kRemote = 2;    ///< Requests data instead of carrying it; holds as many zero bytes as it requests.
constexpr unsigned kError = 4;     ///< Reports an error on the bus.
constexpr unsigned kFd = 8;        ///< CAN FD: up to 64 bytes.
constexpr unsigned kRateSwitch = 16;  ///< CAN FD with the data phase at its own bit rate.

/// Length of the longest frame [byte].
constexpr std::size_t kLongestFrame = 64;

/// A frame whose data belong to whoever hands it over, and are read before it goes on.
struct Frame {
  std::uint32_t identifier = 0;
  unsigned kind = kClassic;
  const std::uint8_t* data = nullptr;
  std::size_t length = 0;  ///< [byte].
};

/// Whether a frame is one of CAN FD without bit rate switch.
inline bool is_unswitched(const Frame& frame) { return (frame.kind & (kFd | kRateSwitch)) == kFd; }

}  // namespace posfet::protocol
