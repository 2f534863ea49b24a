// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the frames of a board with its own protocol hold, as its DBC file says.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "posfet_core/protocol/integers.hpp"

namespace posfet::protocol {

__extension__ typedef unsigned __int128 UnsignedWide;  // NOLINT(modernize-use-using): as that of `Wide`

/// Longest signal [bit], but for that of a count, and longest signal of a count.
constexpr unsigned kLongestSignal = 64;
constexpr unsigned kLongestCount = 16;

/// Shortest scan period and longest step of a board's time [ns]: whatever is counted by them fits into `Wide`.
constexpr double kShortestPeriod = 1e3;
constexpr double kLongestTick = 1e12;

/// Bytes behind the last one of the wire, which a count is read with.
constexpr std::size_t kWirePadding = 3;

/// Number of different values of so many bits.
inline Wide values_of(unsigned bits) { return static_cast<Wide>(UnsignedWide{1} << bits); }

/// A difference of two values of a number that wraps after so many values, a power of 2: from 0 to less than that.
inline Wide wrapped(Wide difference, Wide values) {
  return static_cast<Wide>(static_cast<UnsignedWide>(difference) & (static_cast<UnsignedWide>(values) - 1));
}

/// Place of a signal: the number in bytes [first, end) shifted right by `shift`, of which `length` bits are kept.
struct BitField {
  std::size_t first = 0;
  std::size_t end = 1;
  bool big = false;  ///< Whether the highest byte comes first.
  unsigned shift = 0;
  unsigned length = 8;

  /// The bits, in data of `end` bytes or more.
  std::uint64_t read(const std::uint8_t* data) const {
    UnsignedWide bits = 0;
    for (std::size_t index = 0; index < end - first; ++index) {
      bits = bits << 8U | UnsignedWide{data[big ? first + index : end - 1 - index]};
    }
    const auto number = static_cast<std::uint64_t>(bits >> shift);
    return length == kLongestSignal ? number : number & ((std::uint64_t{1} << length) - 1);
  }

  /// Whether data of a length [byte] hold it, and `read` can read it.
  bool fits(std::size_t data) const {
    return first < end && end <= data && end - first <= 9 && shift < 8 && 1 <= length && length <= kLongestSignal &&
           shift + length <= 8 * (end - first);
  }
};

/// A signal besides the scan, which is kept until the next one.
struct SignalReading {
  BitField field;
  int temperature = -1;    ///< Index of the temperature sensor, 0 or 1; -1: it is a flag.
  unsigned flag = 0;       ///< Bit of ScanStatus that is set when the signal is not 0.
  std::uint64_t sign = 0;  ///< Bit of the sign; 0: none.
  double scale = 1.0;
  double offset = 0.0;
  double low = 0.0;  ///< Values outside of these are unknown.
  double high = 0.0;

  /// The physical value; NaN outside of its range.
  double value(const std::uint8_t* data) const;
};

/// Block of frames without counts, sequence and time of a scan.
constexpr int kNoBlock = -1;

/// What the frames with one identifier, and one value of its multiplexer, hold.
struct MappedPart {
  int block = kNoBlock;  ///< Position among the frames of a scan.
  std::optional<BitField> sequence;
  std::optional<BitField> time;
  std::vector<SignalReading> readings;
};

/// A value of a multiplexer that selects signals which the mapping does not use.
constexpr int kUnrelatedPart = -1;

/// A message of the DBC that the mapping uses.
struct MappedMessage {
  std::size_t length = 0;          ///< Of its data [byte].
  std::size_t sent_length = 0;     ///< In which CAN sends it, filled up [byte].
  std::optional<BitField> select;  ///< The multiplexer, or the number of the block; without, there is one part, 0.
  std::vector<std::pair<std::uint64_t, int>> parts;  ///< By value of it, ascending: index of the part.
};

/// Place of a taxel's count.
struct CountPlace {
  std::size_t at = 0;  ///< Offset of its frame in the wire [byte].
  BitField field;
  std::size_t base = 0;  ///< Index of its look-up table's first entry.
};

/// All that is needed to decode the frames of a board.
struct MappedTables {
  double period = 1e6;             ///< Scan period [ns].
  std::vector<std::size_t> slots;  ///< Length of each block [byte].
  unsigned sequence_bits = 0;      ///< 0: the board sends none.
  bool sequenced = false;          ///< Whether all blocks hold the sequence.
  unsigned time_bits = 0;          ///< 0: the board sends none.
  bool timed = false;              ///< Whether all blocks hold the time.
  double tick = 0.0;               ///< Step of the time [ns].
  double ticks_back = 0.0;         ///< Steps ahead beyond which a scan is late.
  std::vector<MappedPart> parts;
  std::vector<MappedMessage> messages;
  std::vector<std::pair<std::uint64_t, std::size_t>> kinds;  ///< By `key_of`, ascending: index of the message.
  std::vector<std::pair<std::uint32_t, bool>> identifiers;   ///< Of these messages, and whether they have 29 bits.
  std::vector<CountPlace> counts;
  std::vector<std::uint16_t> table;  ///< Count by raw value, of all scalings; empty: raw values are counts.

  std::size_t blocks() const { return slots.size(); }

  /// Whether all indices and places are within what they refer to.
  bool consistent() const;
};

/// Identifier and kind of a frame as one number.
inline std::uint64_t key_of(std::uint32_t identifier, unsigned kind) { return std::uint64_t{kind} << 32U | identifier; }

/// Entry of a list that ascends by its keys; null if there is none.
template <typename Key, typename Value>
const Value* find_in(const std::vector<std::pair<Key, Value>>& list, Key key) {
  std::size_t low = 0;
  for (std::size_t left = list.size(); left > 0;) {
    const std::size_t half = left / 2;
    if (list[low + half].first < key) {
      low += half + 1;
      left -= half + 1;
    } else {
      left = half;
    }
  }
  return low < list.size() && list[low].first == key ? &list[low].second : nullptr;
}

}  // namespace posfet::protocol
