// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/scan_assembler.hpp"

#include <algorithm>
#include <cstring>

namespace posfet::protocol {

Assembler::Assembler(const ScanFormat& format)
    : format_(format),
      blocks_(format.blocks()),
      length_(format.block_length()),
      counts_(format.taxels, 0),
      wire_(blocks_ * length_, 0),
      received_(blocks_, 0) {}

void Assembler::begin() {
  if (number_ != blocks_) {
    give_up();
  }
  forget_blocks();
  abandoned_ = false;
}

BlockOutcome Assembler::add(std::size_t block, unsigned status, const std::uint8_t* data) {
  if (received_[block]) {
    if (std::memcmp(wire_.data() + block * length_, data, length_) == 0) {
      ++statistics.duplicate;
      return BlockOutcome::kIgnored;
    }
    ++statistics.frozen_counter;
    give_up();
    return BlockOutcome::kConflict;
  }
  if (abandoned_) {
    ++statistics.late;
    take(block, data);
    return BlockOutcome::kIgnored;
  }
  statistics.reordered += behind_ > block ? 1U : 0U;
  status_ = status;
  take(block, data);
  if (number_ != blocks_) {
    return BlockOutcome::kCollected;
  }
  unpack_counts(format_, wire_.data(), counts_.data());
  return BlockOutcome::kComplete;
}

void Assembler::abandon() {
  give_up();
  forget_blocks();
}

void Assembler::count_lost(Counter scans) {
  statistics.lost_scans += scans;
  statistics.missing_frames += scans * blocks_;
}

/// Count the current scan as incomplete, unless it is complete or was counted already.
void Assembler::give_up() {
  if (!abandoned_ && number_ != blocks_) {
    ++statistics.incomplete_scans;
    statistics.missing_frames += blocks_ - number_;
  }
  abandoned_ = true;
}

void Assembler::forget_blocks() {
  std::fill(received_.begin(), received_.end(), std::uint8_t{0});
  number_ = behind_ = 0;
}

void Assembler::take(std::size_t block, const std::uint8_t* data) {
  received_[block] = 1;
  ++number_;
  behind_ = std::max(behind_, block + 1);
  std::memcpy(wire_.data() + block * length_, data, length_);
}

}  // namespace posfet::protocol
