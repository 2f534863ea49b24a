// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/messages.hpp"

#include "posfet_core/protocol/power_ons.hpp"
#include "posfet_core/protocol/scan_format.hpp"

namespace posfet::protocol {

namespace {

constexpr unsigned kChargeResetBit = 0x20;

bool is_short(const Frame& frame) { return frame.kind == kClassic && frame.length == kShortLength; }

}  // namespace

std::optional<Response> parse_response(const Frame& frame) {
  if (!is_short(frame)) {
    return std::nullopt;
  }
  return Response{frame.data[0], frame.data[2], static_cast<std::uint8_t>(frame.data[3] & 0xFU),
                  little_endian_32(frame.data + 4)};
}

std::optional<BoardState> parse_status(const Frame& frame) {
  if (!is_short(frame)) {
    return std::nullopt;
  }
  const unsigned state = frame.data[6];
  const unsigned counters = frame.data[7];
  return BoardState{state & kBoardFlags, static_cast<std::uint8_t>(counters & 0xFU),
                    static_cast<std::uint8_t>(counters >> 4U), (state & kChargeResetBit) != 0};
}

std::optional<std::uint32_t> parse_identity(const Frame& frame) {
  if (!is_short(frame)) {
    return std::nullopt;
  }
  const std::uint32_t period = little_endian_32(frame.data + 4) >> 8U;
  return 1 <= period && period <= kLongestPeriod ? std::optional(period) : std::nullopt;
}

}  // namespace posfet::protocol
