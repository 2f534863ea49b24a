// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/board_decoder.hpp"

#include <algorithm>

#include "posfet_core/protocol/integers.hpp"

namespace posfet::protocol {

BoardDecoder::BoardDecoder(const ScanFormat& format, std::uint32_t base)
    : base_(base), assembler_(format), fd_(assembler_, sync_), classic_(assembler_, sync_) {}

void BoardDecoder::begin_batch(std::int64_t arrival, std::int64_t wall_offset) {
  arrival_ = arrival;
  wall_offset_.read(wall_offset);
  classic_.group().drop_released();
}

Found BoardDecoder::feed(const Frame& frame) {
  const std::uint32_t offset = frame.identifier - base_;
  if ((frame.kind & (kExtended | kError)) == 0 && frame.identifier >= base_) {
    if (fd() && offset == kFdBlockOffset) {
      return feed_fd(frame);
    }
    const bool is_block = offset >= kClassicBlockOffset && offset - kClassicBlockOffset < assembler_.blocks();
    if (!fd() && (is_block || offset == kHeaderOffset)) {
      return feed_classic(frame, offset);
    }
  }
  return feed_other(frame, offset);
}

Found BoardDecoder::feed_fd(const Frame& frame) {
  transit_time.see(frame);
  if (!receiving || !fd_.feed(frame, arrival_)) {
    return Found::kNothing;
  }
  publish(complete(true), fd_.time(), fd_.clock().stalled());
  return Found::kScan;
}

Found BoardDecoder::feed_classic(const Frame& frame, std::uint32_t offset) {
  if (!receiving) {
    return Found::kNothing;
  }
  classic_.group().drop_released();
  if (offset == kHeaderOffset) {
    classic_.feed_header(frame, arrival_);
    return classic_.group().last_released() != nullptr ? Found::kReleased : Found::kNothing;
  }
  if (!classic_.feed(offset - kClassicBlockOffset, frame, arrival_)) {
    return Found::kNothing;
  }
  const CompleteScan scan = complete(classic_.dated());
  const bool stalled = classic_.clock().stalled();
  if (classic_.doubtful()) {
    classic_.hold({scan.sequence, scan.device_time, scan.status, classic_.time(), stalled, {}});
    return Found::kNothing;
  }
  publish(scan, classic_.time(), stalled);
  return Found::kScan;
}

bool BoardDecoder::release() {
  const Held* held = classic_.group().next_released();
  if (held == nullptr) {
    return false;
  }
  std::copy(held->counts.begin(), held->counts.end(), assembler_.counts().begin());
  CompleteScan scan;
  scan.stamp = held->device_time * 1000 + rounded(sync_.offset());
  scan.sequence = held->sequence;
  scan.device_time = held->stated_time;
  scan.status = held->status;
  scan.frames_lost = frames_lost();
  publish(scan, held->device_time, held->stalled || classic_.clock().stalled());
  return true;
}

Counter BoardDecoder::frames_lost() const {
  const ScanStatistics& lost = statistics();  // a malformed block is missing in its scan
  return lost.missing_frames + lost.frozen_counter + traffic.malformed;
}

double BoardDecoder::clock_uncertainty() const {
  return (sync_.uncertainty() + real(ascending_.excess())) / kNanoseconds;
}

void BoardDecoder::set_period(double period, bool confirmed) {
  if (fd()) {
    fd_.announce(period, confirmed);
  } else {
    classic_.announce(period, confirmed);
  }
}

void BoardDecoder::sent(const std::uint8_t* command, std::size_t length) {
  std::optional<Short>& kept = own_commands_[next_command_];
  next_command_ = (next_command_ + 1) % kCommandsKept;
  kept.reset();
  if (length == kShortLength) {  // one of another length is no command
    std::copy_n(command, length, kept.emplace().begin());
  }
}

void BoardDecoder::start() {
  receiving = true;
  transit_time.restart();
  if (fd()) {
    fd_.start();
  } else {
    classic_.start();
  }
}

/// The scan that the assembler holds: sequence, time and status; one that is not `dated` tells nothing of the board's
/// clock, and has no stamp. Else that is the monotonic time of its acquisition [ns].
CompleteScan BoardDecoder::complete(bool dated) {
  CompleteScan scan;
  const Wide time = fd() ? fd_.time() : classic_.time();
  scan.sequence = sequence();
  scan.frames_lost = frames_lost();
  const unsigned flags = state_ ? state_->flags : 0U;
  scan.status = fd() ? assembler_.status() : flags;
  scan.device_time = time;
  if (clock().frozen()) {
    scan.device_time = 0;
    scan.status |= kTimeEstimated;
  }
  if (dated) {
    scan.stamp = sync_.to_monotonic(time, arrival_);
  }
  resets_ |= power_ons_.flags(numbering().boot(), numbering().restarted());
  numbering().clear_restarted();
  return scan;
}

/// Publish a scan, which has a monotonic stamp, in the order of publication.
///
/// It was acquired at `device_time` on the board's clock [us], which is counted on if that has `stalled`.
void BoardDecoder::publish(const CompleteScan& scan, Wide device_time, bool stalled) {
  const Wide stamp = ascending_.stamp(scan.stamp, device_time, arrival_);
  scan_ = scan;
  scan_.status |= resets_;
  resets_ = 0;
  scan_.stamp = stamp + wall_offset_.value();
  scan_.stamp_uncertainty = stalled ? kUnknown : uncertainty(stamp) / kNanoseconds;
  ++scans_;
}

/// The largest error [ns] of the newest scan's stamp [ns], while the board's clock runs.
double BoardDecoder::uncertainty(Wide stamp) const {
  const double late = fd() ? FdScans::kRounding : classic_.late();
  const double early = fd() ? FdScans::kRounding : classic_.early(scan_.sequence);
  return sync_.error(transit_time.current() * kNanoseconds + real(ascending_.excess()) + late * 1000.0, early * 1000.0,
                     real(arrival_ - stamp));
}

/// Process a frame that belongs to no scan: say what it contains, or count it.
Found BoardDecoder::feed_other(const Frame& frame, std::uint32_t offset) {
  if (frame.kind & kError) {
    return Found::kNothing;  // error frames are counted by the bus
  }
  if (!(frame.kind & kExtended)) {
    switch (offset) {
      case kCommandOffset:
        feed_command(frame);
        return Found::kNothing;
      case kResponseOffset:
        if (const auto response = parse_response(frame)) {
          return apply_response(*response);
        }
        return malformed();
      case kStatusOffset:
        if (const auto state = parse_status(frame)) {
          return apply_status(*state, frame);
        }
        return malformed();
      case kIdentityOffset:
        return apply_identity(frame);
      default:
        break;
    }
  }
  ++traffic.unrelated;
  return Found::kNothing;
}

Found BoardDecoder::malformed() {
  ++traffic.malformed;
  return Found::kNothing;
}

void BoardDecoder::feed_command(const Frame& frame) {
  if (is_own(frame)) {
    return;  // some buses hand back what was written
  }
  ++traffic.commands;
  if (frame.kind == kClassic && frame.length > 0 && frame.data[0] == kSetRate) {
    classic_.dispute_period(arrival_);
  }
}

bool BoardDecoder::is_own(const Frame& frame) const {
  if (frame.kind != kClassic || frame.length != kShortLength) {
    return false;
  }
  return std::any_of(own_commands_.begin(), own_commands_.end(), [&frame](const std::optional<Short>& command) {
    return command && std::equal(command->begin(), command->end(), frame.data);
  });
}

Found BoardDecoder::apply_response(const Response& response) {
  if (power_ons_.is_over(response.boot)) {
    return Found::kNothing;
  }
  if (power_ons_.note(response.boot)) {
    end_numbering(response.boot);
  }
  if (response.command == kSetRate && response.result == kOk) {
    if (1 <= response.value && response.value <= kLongestPeriod) {
      set_period(response.value, true);
    } else {
      ++traffic.malformed;
    }
  }
  return Found::kResponse;
}

Found BoardDecoder::apply_status(const BoardState& state, const Frame& frame) {
  if (state_ && std::equal(status_data_.begin(), status_data_.end(), frame.data)) {
    ++traffic.status_repeated;
    return Found::kNothing;
  }
  if (state_ && state.boot == state_->boot) {
    traffic.status_lost += static_cast<unsigned>(state.heartbeat - state_->heartbeat - 1) & 0xFU;
  }
  std::copy_n(frame.data, kShortLength, status_data_.begin());
  state_ = state;
  if (power_ons_.note_status(state.boot, state.charge_reset)) {
    end_numbering(state.boot);
  }
  return Found::kStatus;
}

Found BoardDecoder::apply_identity(const Frame& frame) {
  const auto period = parse_identity(frame);
  if (!period) {
    return malformed();
  }
  set_period(*period, false);
  return Found::kIdentity;
}

/// Stop the numbering of classic scans, unless a scan of this power-on has begun it again.
void BoardDecoder::end_numbering(int boot) {
  if (boot != numbering().boot()) {
    classic_.lose_number();
  }
}

}  // namespace posfet::protocol
