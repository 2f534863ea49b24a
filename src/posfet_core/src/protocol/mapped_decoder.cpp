// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/mapped_decoder.hpp"

#include <algorithm>
#include <limits>

#include "posfet_core/protocol/integers.hpp"
#include "posfet_core/protocol/power_ons.hpp"

namespace posfet::protocol {

MappedDecoder::MappedDecoder(const MappedTables& tables)
    : tables_(tables),
      assembler_(tables_),
      numbering_(tables, assembler_),
      counts_(tables.counts.size()),
      estimated_(tables.sequence_bits > 0 ? 0U : kSequenceEstimated),
      gaps_show_(tables.sequenced || (tables.timed && tables.tick <= tables.period) || tables.blocks() == 1) {
  temperatures_.fill(std::numeric_limits<float>::quiet_NaN());
}

Counter MappedDecoder::frames_lost() const {
  const ScanStatistics& lost = assembler_.statistics;  // a malformed frame is missing in its scan
  return lost.missing_frames + lost.frozen_counter + traffic.malformed;
}

double MappedDecoder::clock_uncertainty() const {
  return tables_.time_bits > 0 ? numbering_.clock_uncertainty() / kNanoseconds : kUnknown;
}

void MappedDecoder::start() {
  receiving = true;
  transit_time.restart();
  assembler_.forget();
}

bool MappedDecoder::begin_batch(std::size_t frames, std::size_t of_board, Wide arrival, std::int64_t wall_offset) {
  traffic.frames += frames;
  wall_offset_.read(wall_offset);
  if (frames == 0) {
    return false;
  }
  if (overflowed_) {
    overflowed_ = false;
    assembler_.abandon();
    return false;
  }
  if (counts_frames() && numbering_.frames_are_missing(arrival, of_board)) {
    assembler_.abandon();
  }
  numbering_.begin_batch(arrival, frames);
  return true;
}

bool MappedDecoder::feed(const Frame& frame) {
  const MappedMessage* const message = message_of(frame);
  if (message == nullptr) {
    count(frame);
    return false;
  }
  if (frame.length != message->length && frame.length != message->sent_length) {
    ++assembler_.statistics.malformed;
    return false;
  }
  transit_time.see(frame);
  const std::uint8_t* const data = frame.data;  // without what CAN fills up
  const std::uint64_t selected = message->select ? message->select->read(data) : 0U;
  const int* const index = find_in(message->parts, selected);
  if (index == nullptr) {
    ++assembler_.statistics.malformed;
    return false;
  }
  if (*index == kUnrelatedPart) {
    ++traffic.unrelated;
    return false;
  }
  const MappedPart& part = tables_.parts[static_cast<std::size_t>(*index)];
  read(part, data);
  if (part.block == kNoBlock || !receiving || !assembler_.add(part, data) || !numbering_.accept()) {
    return false;
  }
  complete();
  return true;
}

const MappedMessage* MappedDecoder::message_of(const Frame& frame) const {
  const std::size_t* const index = find_in(tables_.kinds, key_of(frame.identifier, frame.kind));
  return index != nullptr ? &tables_.messages[*index] : nullptr;
}

void MappedDecoder::read(const MappedPart& part, const std::uint8_t* data) {
  for (const SignalReading& reading : part.readings) {
    if (reading.flag == 0) {
      temperatures_.at(static_cast<std::size_t>(reading.temperature)) = static_cast<float>(reading.value(data));
    } else if (reading.field.read(data) != 0) {
      flags_ |= reading.flag;
    } else {
      flags_ &= ~reading.flag;
    }
  }
}

/// Count a frame that is no message of the board.
void MappedDecoder::count(const Frame& frame) {
  if (frame.kind & kError) {
    return;  // error frames are counted by the bus
  }
  const std::pair<std::uint32_t, bool> identifier(frame.identifier, (frame.kind & kExtended) != 0);
  if (std::find(tables_.identifiers.begin(), tables_.identifiers.end(), identifier) != tables_.identifiers.end()) {
    ++assembler_.statistics.malformed;
  } else {
    ++traffic.unrelated;
  }
}

/// Complete the scan: counts, sequence, time and status.
void MappedDecoder::complete() {
  assembler_.decode_counts(counts_.data());
  scan_.sequence = numbering_.sequence();
  scan_.status = flags_ | estimated_;
  const bool dated = tables_.time_bits > 0 && !numbering_.clock_frozen();
  scan_.device_time = dated ? numbering_.device_time() : Wide{0};
  scan_.status |= dated ? 0U : kTimeEstimated;
  scan_.stamp = numbering_.stamp() + wall_offset_.value();
  scan_.stamp_uncertainty =
      dated ? transit_time.current() + clock_uncertainty() + tables_.tick / kNanoseconds : kUnknown;
  if (numbering_.was_reset()) {
    scan_.status |= kBoardReset;
    ++resets_;
  }
  scan_.frames_lost = frames_lost();
  ++scans_;
}

}  // namespace posfet::protocol
