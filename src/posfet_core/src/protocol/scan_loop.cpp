// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
#include "posfet_core/protocol/scan_loop.hpp"

#include <algorithm>
#include <limits>
#include <mutex>
#include <utility>

namespace posfet::protocol {

namespace {

/// The nearest time of 64 bits.
std::int64_t narrow(Wide time) {
  constexpr Wide kLeast = std::numeric_limits<std::int64_t>::min();
  constexpr Wide kMost = std::numeric_limits<std::int64_t>::max();
  return static_cast<std::int64_t>(std::clamp(time, kLeast, kMost));
}

}  // namespace

LoopEnd ScanLoop::run(const ScanSink& sink, const ScanContext& context, std::int64_t end) {
  for (bool first = true;; first = false) {
    {
      const std::scoped_lock lock(control_.mutex());
      if (control_.take_request()) {
        return LoopEnd::kWoken;
      }
      LoopEnd found = LoopEnd::kTimeout;
      if (process(sink, context, found)) {
        return found;
      }
    }
    if (!first && monotonic_now() >= end) {
      return LoopEnd::kTimeout;
    }
    switch (wait_until(port_.descriptor(), control_.descriptor(), end)) {
      case Waited::kReadable:
        break;
      case Waited::kInterrupted:
        return LoopEnd::kInterrupted;
      case Waited::kTimeout:
        return LoopEnd::kTimeout;
      case Waited::kWoken:
        control_.clear_event();
        continue;
    }
    if (!read()) {
      port_.hand_back();
      return LoopEnd::kHanded;
    }
  }
}

bool ScanLoop::advance(LoopEnd& found) { return process({}, {}, found); }

/// Read a batch and begin it; return false when it is not for the loop.
bool ScanLoop::read() {
  const bool received = port_.receive();
  if (port_.failed()) {
    return false;
  }
  const std::scoped_lock lock(control_.mutex());
  if (received) {
    port_.parse();
  }
  if (port_.remarkable() || !received) {
    return !port_.remarkable();
  }
  arrival_ = monotonic_now();
  wall_offset_ = wall_now() - arrival_;
  decoder_.traffic.frames += port_.frames().size();
  decoder_.begin_batch(narrow(arrival_time_.of_newest(port_.stamp(), arrival_, wall_offset_)), wall_offset_);
  pending_ = true;
  complete_ = releasing_ = false;
  next_ = 0;
  return true;
}

/// Process what is left of the batch; return false at its end, true where Python is needed.
bool ScanLoop::process(const ScanSink& sink, const ScanContext& context, LoopEnd& found) {
  while (pending_) {
    if (is_complete()) {
      switch (hand_on(sink, context)) {
        case Taken::kTaken:
          ++taken_;
          break;
        case Taken::kLast:
          ++taken_;
          found = LoopEnd::kLast;
          return true;
        case Taken::kRefused:
          found = LoopEnd::kScan;
          return true;
      }
      continue;
    }
    if (next_ == port_.frames().size()) {
      end_batch();
      break;
    }
    const Found brought = decoder_.feed(port_.frames()[next_++].frame());
    releasing_ = brought == Found::kReleased;
    complete_ = brought == Found::kScan;
    if (brought == Found::kStatus || brought == Found::kResponse || brought == Found::kIdentity) {
      found = LoopEnd::kMessage;
      return true;
    }
  }
  return false;
}

/// Whether the decoder has one more scan of the frames that it was given.
bool ScanLoop::is_complete() {
  if (std::exchange(complete_, false)) {
    return true;
  }
  releasing_ = releasing_ && decoder_.release();
  return releasing_;
}

Taken ScanLoop::hand_on(const ScanSink& sink, const ScanContext& context) const {
  if (sink.take == nullptr) {
    return Taken::kRefused;
  }
  const CompleteScan& complete = decoder_.scan();
  Scan scan;
  scan.stamp = narrow(complete.stamp);
  scan.layout = context.layout;
  scan.sequence = static_cast<std::uint64_t>(std::max<std::int64_t>(complete.sequence, 0));
  scan.device_time = narrow(complete.device_time);
  scan.status = complete.status;
  scan.counts = decoder_.assembler().counts().data();
  scan.taxels = decoder_.assembler().counts().size();
  scan.temperatures = context.temperatures;
  scan.sensors = context.sensors;
  return sink.take(sink.object, scan);
}

void ScanLoop::end_batch() {
  pending_ = false;
  decoder_.end_batch();
  for (const StoredFrame& frame : port_.frames()) {
    ++frame_counts_[frame.kind % kKinds][std::min(frame.length, kLongestFrame)];
  }
}

}  // namespace posfet::protocol
