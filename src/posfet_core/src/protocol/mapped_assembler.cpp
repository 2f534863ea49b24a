// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/mapped_assembler.hpp"

#include <algorithm>
#include <cstring>

namespace posfet::protocol {

Wide late_scans(unsigned bits) { return std::min(Wide{kLateScans}, values_of(bits) / 4); }

MappedAssembler::MappedAssembler(const MappedTables& tables)
    : table_(tables.table),
      received_(tables.blocks()),
      sequenced_(tables.sequenced),
      wrap_(values_of(tables.sequence_bits)),
      newest_(wrap_ - 1 - late_scans(tables.sequence_bits)),
      repeats_are_told_(tables.blocks() > 1 || (tables.tick > 0.0 && tables.tick <= tables.period)) {
  offsets_.push_back(0);
  for (const std::size_t length : tables.slots) {
    offsets_.push_back(offsets_.back() + length);
  }
  wire_.resize(offsets_.back() + kWirePadding);
  for (const CountPlace& place : tables.counts) {
    const BitField& field = place.field;
    const unsigned unused = field.big ? 8U * (4U - static_cast<unsigned>(field.end - field.first)) : 0U;
    places_.push_back({static_cast<std::uint32_t>(place.at + field.first), static_cast<std::uint32_t>(place.base),
                       static_cast<std::uint16_t>((1U << field.length) - 1U),
                       static_cast<std::uint8_t>(unused + field.shift), field.big});
  }
  fill();
}

bool MappedAssembler::add(const MappedPart& part, const std::uint8_t* data) {
  const auto block = static_cast<std::size_t>(part.block);
  const Wide sequence = part.sequence ? static_cast<Wide>(part.sequence->read(data)) : Wide{kNone};
  const Wide time = part.time ? static_cast<Wide>(part.time->read(data)) : Wide{kNone};
  if (!(sequenced_ ? leads(block, sequence, data) : continues(block, sequence, time, data))) {
    return false;
  }
  if (sequence >= 0) {
    sequence_ = sequence;
  }
  receive(block, data);
  last_ = part.block;
  if (time >= 0) {
    time_ = time;
  }
  if (!whole()) {
    return false;
  }
  joining_ = false;
  return true;
}

void MappedAssembler::decode_counts(std::uint16_t* out) const {
  const std::uint8_t* const wire = wire_.data();
  const std::uint16_t* const table = table_.empty() ? nullptr : table_.data();
  for (const Place& place : places_) {
    const std::uint8_t* const at = wire + place.at;
    const std::uint32_t first = at[0];
    const std::uint32_t second = at[1];
    const std::uint32_t third = at[2];
    const std::uint32_t fourth = at[3];
    const std::uint32_t little = first | second << 8U | third << 16U | fourth << 24U;
    const std::uint32_t big = first << 24U | second << 16U | third << 8U | fourth;
    const std::uint32_t raw = (place.big ? big : little) >> place.shift & place.mask;
    *out++ = table != nullptr ? table[place.base + raw] : static_cast<std::uint16_t>(raw);
  }
}

void MappedAssembler::abandon() {
  if (collecting() && !joining_) {
    ++statistics.incomplete_scans;
    statistics.missing_frames += received_.size() - received_count_;
    ++incomplete_;
  }
  abandoned_ = true;
}

void MappedAssembler::forget() {
  abandon();
  sequence_ = last_ = kNone;
  fill();
  joining_ = true;
}

bool MappedAssembler::same_data(std::size_t block, const std::uint8_t* data) const {
  return std::equal(wire_.begin() + static_cast<std::ptrdiff_t>(offsets_[block]),
                    wire_.begin() + static_cast<std::ptrdiff_t>(offsets_[block + 1]), data);
}

void MappedAssembler::receive(std::size_t block, const std::uint8_t* data) {
  std::copy_n(data, offsets_[block + 1] - offsets_[block],
              wire_.begin() + static_cast<std::ptrdiff_t>(offsets_[block]));
  received_count_ += received_[block] == 0 ? 1 : 0;
  received_[block] = 1;
  highest_ = std::max(highest_, static_cast<int>(block));
}

/// Count the current scan as received: none has begun.
void MappedAssembler::fill() {
  std::fill(received_.begin(), received_.end(), std::uint8_t{1});
  received_count_ = received_.size();
  highest_ = static_cast<int>(received_.size()) - 1;
}

void MappedAssembler::begin() {
  if (!whole()) {
    abandon();
    joining_ = false;
  }
  std::fill(received_.begin(), received_.end(), std::uint8_t{0});
  received_count_ = 0;
  highest_ = kNone;
  abandoned_ = false;
  sequence_ = time_ = kNone;
}

/// Whether a frame with a sequence belongs to the current scan or is the first of another one.
bool MappedAssembler::leads(std::size_t block, Wide sequence, const std::uint8_t* data) {
  if (sequence == sequence_) {
    const bool in_order = received_[block] == 0 && !abandoned_ && highest_ < static_cast<int>(block);
    return in_order || joins(block, data);
  }
  const Wide ahead = sequence_ >= 0 ? wrapped(sequence - sequence_, wrap_) : Wide{0};
  if (ahead > newest_) {
    ++statistics.late;
    return false;
  }
  begin();
  passed_ += ahead;
  return true;
}

/// Whether a frame with the sequence of the current scan, but out of order, belongs to it.
bool MappedAssembler::joins(std::size_t block, const std::uint8_t* data) {
  if (received_[block] != 0) {
    if (same_data(block, data)) {
      ++statistics.duplicate;
    } else {  // two scans share one counter
      ++statistics.frozen_counter;
      abandon();
    }
    return false;
  }
  if (abandoned_) {
    ++statistics.late;
    return false;
  }
  ++statistics.reordered;
  return true;
}

/// Whether a frame without sequence continues the current scan or is the first of the next.
bool MappedAssembler::continues(std::size_t block, Wide sequence, Wide time, const std::uint8_t* data) {
  const bool agrees =
      (sequence == sequence_ || sequence < 0 || sequence_ < 0) && (time == time_ || time < 0 || time_ < 0);
  const int number = static_cast<int>(block);
  if (agrees && number == last_ && repeats_are_told_ && same_data(block, data)) {
    ++statistics.duplicate;
    return false;
  }
  if (block == 0) {
    begin();
    joining_ = false;
    return true;
  }
  if (agrees && collecting() && highest_ < number) {
    return true;
  }
  abandon();
  last_ = kNone;
  statistics.late += joining_ ? 0U : 1U;
  return false;
}

}  // namespace posfet::protocol
