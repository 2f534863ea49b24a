// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Short messages of a board, as far as they concern its scans, and all identifiers.
#pragma once

#include <cstdint>
#include <optional>

#include "posfet_core/protocol/frame.hpp"

namespace posfet::protocol {

/// Identifier of each frame less the board's base identifier; classic block k has this offset plus k.
constexpr std::uint32_t kCommandOffset = 0;
constexpr std::uint32_t kResponseOffset = 1;
constexpr std::uint32_t kStatusOffset = 2;
constexpr std::uint32_t kFdBlockOffset = 3;
constexpr std::uint32_t kHeaderOffset = 4;
constexpr std::uint32_t kIdentityOffset = 5;
constexpr std::uint32_t kClassicBlockOffset = 8;

/// Length of all frames but FD blocks [byte].
constexpr std::size_t kShortLength = 8;

/// Code of the command that sets the scan period.
constexpr std::uint8_t kSetRate = 3;

/// Result of a command that was executed.
constexpr std::uint8_t kOk = 0;

/// Longest scan period [us].
constexpr std::uint32_t kLongestPeriod = 10'000'000;

/// Response of a board to a command.
struct Response {
  std::uint8_t command = 0;
  std::uint8_t result = 0;
  std::uint8_t boot = 0;  ///< Number of the power-on, modulo 16.
  std::uint32_t value = 0;
};

/// What a status says of the board.
struct BoardState {
  unsigned flags = 0;          ///< Bits of ScanStatus that a board sends.
  std::uint8_t boot = 0;       ///< Number of the power-on, modulo 16.
  std::uint8_t heartbeat = 0;  ///< Number of the status frame, modulo 16.
  bool charge_reset = false;   ///< Whether the charge at the gates was reset at this power-on.
};

/// The message in a frame; none when kind or length are wrong.
std::optional<Response> parse_response(const Frame& frame);
std::optional<BoardState> parse_status(const Frame& frame);

/// The scan period that an identity states [us]; none when kind, length or period are wrong.
std::optional<std::uint32_t> parse_identity(const Frame& frame);

}  // namespace posfet::protocol
