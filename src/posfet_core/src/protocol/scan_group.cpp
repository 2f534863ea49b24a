// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/scan_group.hpp"

#include <algorithm>

namespace posfet::protocol {

ScanGroup::ScanGroup(const TickLine& ticks, Assembler& assembler)
    : ticks_(ticks), assembler_(assembler), slots_(kMostHeld + 1) {
  for (Slots* slots : {&free_, &held_, &released_}) {
    slots->reserve(slots_.size());
  }
  for (std::size_t slot = slots_.size(); slot > 0; --slot) {
    slots_[slot - 1].counts.resize(assembler.counts().size());
    free_.push_back(static_cast<std::uint8_t>(slot - 1));
  }
}

bool ScanGroup::hold(const Held& scan) {
  drop_released();
  if (free_.empty()) {
    return false;
  }
  const std::uint8_t slot = free_.back();
  free_.pop_back();
  held_.push_back(slot);
  Held& kept = slots_[slot];
  kept.sequence = scan.sequence;
  kept.stated_time = scan.stated_time;
  kept.status = scan.status;
  kept.device_time = scan.device_time;
  kept.timed = ticks_.certain();
  kept.stalled = scan.stalled;
  std::copy(assembler_.counts().begin(), assembler_.counts().end(), kept.counts.begin());
  return held_.size() <= kMostHeld;
}

void ScanGroup::drop() {
  drop_untimed();
  free_all(held_);
}

void ScanGroup::drop_untimed() {
  assembler_.count_lost(carried_);
  std::size_t kept = 0;
  for (std::size_t index = 0; index < held_.size(); ++index) {
    const std::uint8_t slot = held_[index];
    if (index >= carried_ && slots_[slot].timed) {
      held_[kept++] = slot;
    } else {
      free_.push_back(slot);
    }
  }
  held_.resize(kept);
  carried_ = 0;
}

void ScanGroup::count_lost(std::int64_t scans) {
  assembler_.count_lost(static_cast<Counter>(scans));
  accounted += scans;
}

void ScanGroup::restart() {
  assembler_.count_lost(held_.size());
  free_all(held_);
  begin(false);
}

void ScanGroup::end(std::int64_t header, std::int64_t missing, bool right, bool next_complete) {
  drop_released();
  const auto carried = static_cast<std::int64_t>(carried_);
  const Counter incomplete = incomplete_;
  const std::int64_t before = accounted;
  begin(next_complete);
  std::size_t kept = 0;
  for (const std::uint8_t slot : held_) {
    Held& held = slots_[slot];
    if (right && (held.timed || ticks_.certain())) {
      set_time(held, header);
      released_.push_back(slot);
    } else if (right && ticks_.spans(held.sequence)) {
      held_[kept++] = slot;
    } else {
      free_.push_back(slot);
    }
  }
  held_.resize(kept);
  carried_ = kept;
  const auto settled = static_cast<std::int64_t>(released_.size() + carried_) - carried;
  const auto abandoned = static_cast<std::int64_t>(incomplete_ - incomplete);
  const std::int64_t known = before + abandoned + settled - (next_complete ? 1 : 0);
  assembler_.count_lost(static_cast<Counter>(std::max(missing + 1 - known, std::int64_t{0})));
}

const Held* ScanGroup::next_released() { return taken_ < released_.size() ? &slots_[released_[taken_++]] : nullptr; }

void ScanGroup::drop_released() {
  free_all(released_);
  taken_ = 0;
}

/// Begin the next group, whose first scan may be `complete`.
void ScanGroup::begin(bool complete) {
  carried_ = 0;
  accounted = complete ? 1 : 0;
  incomplete_ = assembler_.statistics.incomplete_scans;
}

/// Set the time of a scan that was held by the ticks up to the newest header.
///
/// That may show that the headers before were sampled late, and so the times that were counted from them too high.
void ScanGroup::set_time(Held& held, std::int64_t header) const {
  if (held.sequence == header || (held.timed && !ticks_.continued())) {
    return;
  }
  const Wide time = ticks_.time(held.sequence);
  if (held.timed && time >= held.device_time) {
    return;
  }
  held.stated_time = held.stated_time != 0 ? time : Wide{0};
  held.device_time = time;
  held.timed = true;
}

void ScanGroup::free_all(Slots& slots) {
  free_.insert(free_.end(), slots.begin(), slots.end());
  slots.clear();
}

}  // namespace posfet::protocol
