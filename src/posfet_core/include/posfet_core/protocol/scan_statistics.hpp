// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Frames and scans that were lost or rejected, and frames that carry no scan, by cause.
#pragma once

#include <cstdint>

namespace posfet::protocol {

/// A counter that never falls.
using Counter = std::uint64_t;

/// Frames and scans that were lost or rejected, by cause.
struct ScanStatistics {
  Counter malformed = 0;       ///< Frames with one of the board's identifiers and a wrong length, type or block index.
  Counter checksum = 0;        ///< FD blocks whose checksum does not fit their data.
  Counter duplicate = 0;       ///< Frames that arrived twice.
  Counter frozen_counter = 0;  ///< Frames that repeat an old scan counter with other data: the counter is frozen.
  Counter implausible = 0;     ///< Scans and headers whose sequence runs ahead of all clocks.
  Counter reordered = 0;       ///< Blocks that arrived after a later block of their scan; nothing is lost.
  Counter late = 0;            ///< Frames of a scan that had already been abandoned.
  Counter incomplete_scans = 0;  ///< Scans of which only some blocks arrived.
  Counter lost_scans = 0;        ///< Scans of which no block arrived.
  Counter missing_frames = 0;    ///< Frames of incomplete and lost scans that did not arrive.
};

/// Frames that carry no scan of the board, by cause.
struct Traffic {
  Counter frames = 0;           ///< All frames on the bus, error frames included.
  Counter commands = 0;         ///< Commands to the board from other hosts, or from this one before it closed the bus.
  Counter unrelated = 0;        ///< Frames of other nodes on the bus.
  Counter malformed = 0;        ///< Messages of the wrong length or type, or with an impossible value.
  Counter status_lost = 0;      ///< Status frames that did not arrive, by their heartbeat.
  Counter status_repeated = 0;  ///< Status frames that repeat the one before.
};

}  // namespace posfet::protocol
