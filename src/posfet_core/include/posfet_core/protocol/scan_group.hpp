// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Classic scans that wait for a header to confirm their number or time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "posfet_core/protocol/integers.hpp"
#include "posfet_core/protocol/scan_assembler.hpp"
#include "posfet_core/protocol/scan_format.hpp"
#include "posfet_core/protocol/tick_line.hpp"

namespace posfet::protocol {

/// Scans that are held at most: by then two headers were lost, or the board sends none.
constexpr std::size_t kMostHeld = std::size_t{2} * kHeaderScans;

/// A complete scan whose number or time is not confirmed yet.
struct Held {
  std::int64_t sequence = 0;
  Wide stated_time = 0;  ///< Device time that the scan states [us]: 0 while the board's clock is frozen.
  unsigned status = 0;   ///< Bits of ScanStatus.
  Wide device_time = 0;  ///< Its time on the board's clock, unwrapped [us].
  bool stalled = false;  ///< Whether the board's clock stood still: its time is counted on, nobody knows how wrong.
  std::vector<std::uint16_t> counts;  ///< Of one that is held; shape [taxels].
  bool timed = true;  ///< Of one that is held: whether its time is certain, else the next header tells it.
};

/// The scans since the newest header, and older ones whose time the next header may tell.
class ScanGroup {
public:
  /// `ticks` tells the time of a scan; `assembler` counts what is lost, and holds the counts of the current scan.
  ScanGroup(const TickLine& ticks, Assembler& assembler);

  /// Scans since the newest header that were delivered or counted as lost.
  std::int64_t accounted = 0;

  /// Whether any scan is held.
  bool waits() const { return !held_.empty(); }

  /// Hold a complete scan, whose counts the assembler holds, until the next header; return whether there was room.
  ///
  /// Too many are held with the last one: all are to be dropped then.
  bool hold(const Held& scan);

  /// Drop all that is held: the next header counts it as lost.
  void drop();

  /// Drop the scans whose time is not certain, and those that are older than the newest header.
  void drop_untimed();

  /// Count scans since the newest header as lost.
  void count_lost(std::int64_t scans);

  /// Begin with the next header: how many scans are missing before it is not known.
  void restart();

  /// Account for the scans up to the next header, which is on the line of ticks already.
  ///
  /// `header` is the sequence of the header of this group, `missing` the number of scans between the two, `right`
  /// whether the next header confirms the numbers that were counted, `next_complete` whether its scan was completed,
  /// and accounted for here. The scans that were held and have the right number are released; those whose time the
  /// header after that may tell are held on.
  void end(std::int64_t header, std::int64_t missing, bool right, bool next_complete);

  /// The next scan that was released; null when there is none. It stays until the next call.
  const Held* next_released();

  /// The last scan that was released; null when there is none.
  const Held* last_released() const { return released_.empty() ? nullptr : &slots_[released_.back()]; }

  /// Drop the scans that were released and are not used.
  void drop_released();

private:
  using Slots = std::vector<std::uint8_t>;  ///< Indices of slots; they have room for all, so that nothing is allocated.

  void begin(bool complete);
  void set_time(Held& held, std::int64_t header) const;
  void free_all(Slots& slots);

  const TickLine& ticks_;
  Assembler& assembler_;
  std::vector<Held> slots_;
  Slots free_;
  Slots held_;
  Slots released_;
  std::size_t taken_ = 0;    ///< Of the released ones, those that were taken.
  std::size_t carried_ = 0;  ///< Of the held ones, those that are older than the newest header.
  Counter incomplete_ = 0;   ///< Incomplete scans up to the newest header.
};

}  // namespace posfet::protocol
