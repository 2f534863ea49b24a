// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Scans of CAN FD blocks, each of which states boot, sequence and time in full.
#pragma once

#include <cstdint>

#include "posfet_core/protocol/clock_sync.hpp"
#include "posfet_core/protocol/device_clock.hpp"
#include "posfet_core/protocol/frame.hpp"
#include "posfet_core/protocol/scan_assembler.hpp"
#include "posfet_core/protocol/scan_numbering.hpp"

namespace posfet::protocol {

/// Assigns each FD block to its scan.
class FdScans {
public:
  /// `assembler` collects the blocks; `sync` is the mapping of the board's clock.
  FdScans(Assembler& assembler, ClockSync& sync)
      : assembler_(assembler), clock_(kFdClockBits, sync), numbering_(assembler.statistics, clock_, true) {}

  FdScans(const FdScans&) = delete;
  FdScans& operator=(const FdScans&) = delete;

  /// Error of a device time [us]: that by which a scan may have been sampled before or after its time.
  static constexpr double kRounding = 1.0;

  const DeviceClock& clock() const { return clock_; }
  ScanNumbering& numbering() { return numbering_; }
  const ScanNumbering& numbering() const { return numbering_; }

  /// Sequence of the current scan, unwrapped; -1 before the first.
  std::int64_t sequence() const { return numbering_.sequence(); }

  /// Device time of the current scan, unwrapped [us].
  Wide time() const { return clock_.time(); }

  /// Take a scan period that the board announces [us]; `confirmed` says whether it was set.
  void announce(double period, bool confirmed) { numbering_.announce(period, confirmed); }

  /// Accept any number next: the board was started.
  void start() { numbering_.open(); }

  /// Process the frame of a block that arrived at a monotonic time [ns]; return whether it completed a scan, which the
  /// assembler then holds.
  bool feed(const Frame& frame, Wide arrival);

private:
  bool begin(const FdHeader& header, Wide arrival);

  Assembler& assembler_;
  DeviceClock clock_;
  ScanNumbering numbering_;
  bool begun_ = false;  ///< There is a current scan.
  FdHeader current_;    ///< Of the current scan.
};

}  // namespace posfet::protocol
