// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Frames as a SocketCAN socket hands them over: struct can_frame and canfd_frame of linux/can.h.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>

#include "posfet_core/protocol/frame.hpp"

namespace posfet::protocol {

/// Length of struct canfd_frame; one of another length is a struct can_frame [byte].
constexpr std::size_t kKernelFdFrame = 72;

/// Length of what precedes the data: identifier with flags, data length, flags of CAN FD, 2 bytes [byte].
constexpr std::size_t kKernelHeader = 8;

/// The frame in the bytes that one read has returned, whose data it refers to; none when they are too few.
inline std::optional<Frame> parse_kernel_frame(const std::uint8_t* bytes, std::size_t size) {
  constexpr std::uint32_t kExtendedFlag = 0x8000'0000;
  constexpr std::uint32_t kRemoteFlag = 0x4000'0000;
  constexpr std::uint32_t kErrorFlag = 0x2000'0000;
  constexpr std::uint8_t kRateSwitchFlag = 0x01;
  if (size < kKernelHeader) {
    return std::nullopt;
  }
  std::uint32_t identifier = 0;
  std::memcpy(&identifier, bytes, sizeof identifier);
  Frame frame;
  frame.identifier = identifier & ~(kExtendedFlag | kRemoteFlag | kErrorFlag);
  frame.kind = (identifier & kExtendedFlag ? kExtended : 0U) | (identifier & kRemoteFlag ? kRemote : 0U) |
               (identifier & kErrorFlag ? kError : 0U);
  if (size == kKernelFdFrame) {
    frame.kind |= bytes[5] & kRateSwitchFlag ? kFd | kRateSwitch : kFd;
  }
  frame.data = bytes + kKernelHeader;
  frame.length = std::min<std::size_t>(bytes[4], size - kKernelHeader);
  return frame;
}

}  // namespace posfet::protocol
