// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/scan_format.hpp"

#include <algorithm>

namespace posfet::protocol {

namespace {

constexpr std::size_t kCovered = 10;  // bytes before the checksum
constexpr std::size_t kFdCounts = 12;
constexpr unsigned kPolynomial = 0x1021;
constexpr unsigned kInitial = 0xFFFF;
constexpr std::size_t kStride = 8;

using Table = std::array<std::uint16_t, 256>;

/// Table k holds what a byte contributes to the CRC of it and k bytes of 0 behind it.
constexpr std::array<Table, kStride> crc_tables() {
  std::array<Table, kStride> tables{};
  for (unsigned byte = 0; byte < 256; ++byte) {
    unsigned crc = byte << 8U;
    for (int bit = 0; bit < 8; ++bit) {
      crc = (crc << 1U ^ ((crc & 0x8000U) != 0 ? kPolynomial : 0U)) & 0xFFFFU;
    }
    tables[0][byte] = static_cast<std::uint16_t>(crc);
  }
  for (std::size_t zeros = 1; zeros < kStride; ++zeros) {
    for (std::size_t byte = 0; byte < 256; ++byte) {
      const unsigned crc = tables[zeros - 1][byte];
      tables[zeros][byte] = static_cast<std::uint16_t>((crc << 8U ^ tables[0][crc >> 8U]) & 0xFFFFU);
    }
  }
  return tables;
}

constexpr std::array<Table, kStride> kTables = crc_tables();

unsigned crc_of(unsigned crc, const std::uint8_t* data, std::size_t length) {
  for (; length >= kStride; length -= kStride, data += kStride) {
    unsigned next = static_cast<unsigned>(kTables[7][data[0] ^ crc >> 8U]) ^ kTables[6][data[1] ^ (crc & 0xFFU)];
    for (std::size_t index = 2; index < kStride; ++index) {
      next ^= kTables[kStride - 1 - index][data[index]];
    }
    crc = next;
  }
  for (; length > 0; --length, ++data) {
    crc = (crc << 8U & 0xFFFFU) ^ kTables[0][*data ^ crc >> 8U];
  }
  return crc;
}

void unpack_fd(const std::uint8_t* block, std::uint16_t* counts, std::size_t taxels) {
  const std::uint8_t* sent = block + kFdCounts;
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    counts[taxel] = static_cast<std::uint16_t>(sent[2 * taxel] | unsigned{sent[2 * taxel + 1]} << 8U);
  }
}

/// The 12 bits of a code are the high ones of a count; its high four bits are repeated below them.
void unpack_classic(const std::uint8_t* block, std::uint16_t* counts, std::size_t taxels) {
  const std::uint64_t word = std::uint64_t{little_endian_32(block + 4)} << 32U | little_endian_32(block);
  for (std::size_t taxel = 0; taxel < taxels; ++taxel) {
    const auto code = static_cast<unsigned>(word >> (4 + 12 * taxel) & 0xFFFU);
    counts[taxel] = static_cast<std::uint16_t>(code << 4U | code >> 8U);
  }
}

}  // namespace

FdHeader fd_header(const std::uint8_t* data) {
  return {little_endian_32(data),
          little_endian_32(data + 4),
          data[8],
          static_cast<std::uint8_t>(data[9] & 0xFU),
          static_cast<std::uint8_t>(data[9] >> 4U),
          static_cast<std::uint16_t>(data[10] | unsigned{data[11]} << 8U)};
}

std::uint16_t fd_checksum(const std::uint8_t* data) {
  const unsigned crc = crc_of(kInitial, data, kCovered);
  return static_cast<std::uint16_t>(crc_of(crc, data + kFdCounts, kFdLength - kFdCounts));
}

std::optional<ScanHeader> scan_header(const Frame& frame) {
  if (frame.kind != kClassic || frame.length != kClassicLength) {
    return std::nullopt;
  }
  const std::uint32_t time = little_endian_32(frame.data + 4);
  return ScanHeader{static_cast<std::uint8_t>(time >> kHeaderClockBits), little_endian_32(frame.data),
                    time & ((1U << kHeaderClockBits) - 1)};
}

void unpack_counts(const ScanFormat& format, const std::uint8_t* wire, std::uint16_t* counts) {
  const auto unpack = format.fd ? unpack_fd : unpack_classic;
  const std::size_t most = format.taxels_per_block();
  for (std::size_t first = 0; first < format.taxels; first += most, wire += format.block_length()) {
    unpack(wire, counts + first, std::min(most, format.taxels - first));
  }
}

}  // namespace posfet::protocol
