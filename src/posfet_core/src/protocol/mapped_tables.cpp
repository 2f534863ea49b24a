// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/mapped_tables.hpp"

#include <algorithm>
#include <limits>

namespace posfet::protocol {

namespace {

bool is_block(int block, std::size_t blocks) {
  return block == kNoBlock || (block >= 0 && static_cast<std::size_t>(block) < blocks);
}

bool fits_all(const MappedPart& part, const MappedMessage& message, const MappedTables& tables) {
  const auto fits = [&message](const std::optional<BitField>& field) { return !field || field->fits(message.length); };
  const auto reads = [&message](const SignalReading& reading) {
    const bool known = reading.flag != 0 || reading.temperature == 0 || reading.temperature == 1;
    return known && reading.field.fits(message.length);
  };
  const bool same_length =
      part.block == kNoBlock || tables.slots[static_cast<std::size_t>(part.block)] == message.length;
  return fits(part.sequence) && fits(part.time) && same_length &&
         std::all_of(part.readings.begin(), part.readings.end(), reads);
}

bool ascends(std::uint64_t earlier, std::uint64_t later) { return earlier < later; }

template <typename Key, typename Value>
bool is_sorted(const std::vector<std::pair<Key, Value>>& list) {
  return std::adjacent_find(list.begin(), list.end(), [](const auto& earlier, const auto& later) {
           return !ascends(earlier.first, later.first);
         }) == list.end();
}

}  // namespace

double SignalReading::value(const std::uint8_t* data) const {
  const Wide raw = static_cast<Wide>(field.read(data) ^ sign) - static_cast<Wide>(sign);
  const double physical = real(raw) * scale + offset;
  return low <= physical && physical <= high ? physical : std::numeric_limits<double>::quiet_NaN();
}

bool MappedTables::consistent() const {
  std::size_t wire = 0;
  for (const std::size_t length : slots) {
    wire += length;
  }
  bool right = !slots.empty() && !counts.empty() && period >= kShortestPeriod && sequence_bits <= kLongestSignal &&
               time_bits <= kLongestSignal && tick >= 0.0 && tick <= kLongestTick && is_sorted(kinds);
  right = right && std::all_of(parts.begin(), parts.end(),
                               [this](const MappedPart& part) { return is_block(part.block, blocks()); });
  for (const MappedMessage& message : messages) {
    right = right && message.length <= message.sent_length && is_sorted(message.parts) &&
            (!message.select || message.select->fits(message.length));
    for (const auto& [value, part] : message.parts) {
      right = right && part >= kUnrelatedPart && part < static_cast<int>(parts.size()) &&
              (part == kUnrelatedPart || fits_all(parts[static_cast<std::size_t>(part)], message, *this));
    }
  }
  right = right &&
          std::all_of(kinds.begin(), kinds.end(), [this](const auto& kind) { return kind.second < messages.size(); });
  return right && std::all_of(counts.begin(), counts.end(), [this, wire](const CountPlace& place) {
           const bool converts = table.empty() || place.base + (std::size_t{1} << place.field.length) <= table.size();
           return place.at < wire && place.field.length <= kLongestCount && place.field.fits(wire - place.at) &&
                  converts;
         });
}

}  // namespace posfet::protocol
