// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Format of the frames of scans: five taxels of 12 bits in a classic frame, 26 of 16 bits in a CAN FD frame.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "posfet_core/protocol/frame.hpp"

namespace posfet::protocol {

constexpr std::size_t kClassicTaxels = 5;
constexpr std::size_t kClassicLength = 8;
constexpr std::uint8_t kClassicCounter = 0xF;

/// A header precedes a classic scan at least once in this number of scans.
constexpr int kHeaderScans = kClassicCounter + 1;

/// Bits of the time in a header.
constexpr unsigned kHeaderClockBits = 28;

constexpr std::size_t kFdTaxels = 26;
constexpr std::size_t kFdLength = 64;
constexpr unsigned kFdClockBits = 32;

/// The block index of an FD frame has 8 bits.
constexpr std::size_t kMostBlocks = 256;
constexpr std::size_t kMostTaxels = kMostBlocks * kFdTaxels;

/// Size of the array, and which frames carry it.
struct ScanFormat {
  bool fd = true;
  std::size_t taxels = 0;  ///< In [1, kMostTaxels].

  std::size_t block_length() const { return fd ? kFdLength : kClassicLength; }
  std::size_t taxels_per_block() const { return fd ? kFdTaxels : kClassicTaxels; }
  std::size_t blocks() const { return (taxels + taxels_per_block() - 1) / taxels_per_block(); }
};

/// Header of an FD block.
struct FdHeader {
  std::uint32_t sequence = 0;  ///< Low 32 bits.
  std::uint32_t time = 0;      ///< Device time, low 32 bits [us].
  std::uint8_t block = 0;
  std::uint8_t status = 0;  ///< 4 bits of ScanStatus.
  std::uint8_t boot = 0;    ///< Number of the power-on, modulo 16.
  std::uint16_t checksum = 0;
};

/// Header of a classic scan: the scan whose blocks follow it.
struct ScanHeader {
  std::uint8_t boot = 0;       ///< Number of the power-on, modulo 16.
  std::uint32_t sequence = 0;  ///< Low 32 bits.
  std::uint32_t time = 0;      ///< Device time, low 28 bits [us].
};

/// A number from bytes, the lowest first.
inline std::uint32_t little_endian_32(const std::uint8_t* bytes) {
  return std::uint32_t{bytes[0]} | std::uint32_t{bytes[1]} << 8U | std::uint32_t{bytes[2]} << 16U |
         std::uint32_t{bytes[3]} << 24U;
}

/// The header of an FD block of `kFdLength` bytes.
FdHeader fd_header(const std::uint8_t* data);

/// The CRC-16/CCITT-FALSE of an FD block of `kFdLength` bytes, which leaves out its own two.
std::uint16_t fd_checksum(const std::uint8_t* data);

/// The header in a frame; none when the frame is no header.
std::optional<ScanHeader> scan_header(const Frame& frame);

/// Write the counts in the data of all blocks of a scan, one after another, to `counts`, of all taxels.
void unpack_counts(const ScanFormat& format, const std::uint8_t* wire, std::uint16_t* counts);

}  // namespace posfet::protocol
